#include "lmc/verify_room.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/zonal.h"
#include "libscene/constants.h"

namespace lmc {

namespace {

float radiance(double exitance) { return float(exitance / kPi); }

/// A face of the box as a quad: corner and sides, front inwards.
struct Face {
  glm::dvec3 origin, u, v;
};

std::array<Face, 6> facesOfBox(const glm::dvec3& size) {
  std::array<Face, 6> out;
  const auto polygons = boxFaces(size.x, size.y, size.z);
  for (std::size_t i = 0; i < 6; ++i) out[i] = {polygons[i][0], polygons[i][1] - polygons[i][0], polygons[i][3] - polygons[i][0]};
  return out;
}

}  // namespace

std::vector<std::size_t> facesOf(const Parameters& g) {
  if (!g.has("faces")) return {0, 1, 2, 3, 4, 5};
  const Parameters faces = g["faces"];
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const std::string name = faces.at(i).text();
    const std::size_t axis = name.starts_with("z=") ? 0 : name.starts_with("x=") ? 2 : name.starts_with("y=") ? 4 : 9;
    if (axis == 9 || name.size() < 3) faces.at(i).broken("is no face of a box");
    order.push_back(axis + (name.substr(2) == "0" ? 0 : 1));
  }
  std::vector<std::size_t> sorted = order;
  std::ranges::sort(sorted);
  if (sorted != std::vector<std::size_t>{0, 1, 2, 3, 4, 5}) faces.broken("does not name the six faces of a box");
  return order;
}

double meanOver(const Baked& b, std::span<const double> areas) {
  double sum = 0.0, area = 0.0;
  for (std::uint32_t i = 0; i < areas.size(); ++i) {
    if (areas[i] <= 0.0) continue;
    sum += areas[i] * b.mean(i).x;
    area += areas[i];
  }
  return sum / area;
}

Cube cubeOf(const Parameters& g) {
  Cube out;
  out.side = g.numberOr("side", 1.0);
  const std::vector<std::size_t> order = facesOf(g);
  const std::vector<double> albedo = g["albedo"].numbers(), emission = g["emission"].numbers();
  if (albedo.size() != 6) g["albedo"].broken("has not one entry for each face");
  if (emission.size() != 6) g["emission"].broken("has not one entry for each face");
  std::size_t lampFace = 6;
  double low = 0.0, high = 0.0, lampEmission = 0.0, lampAlbedo = 0.0;
  if (g.has("lamp")) {
    const Parameters lamp = g["lamp"], square = lamp["square"];
    const std::string name = lamp["face"].text();
    const Parameters faces = g["faces"];
    for (std::size_t i = 0; i < 6; ++i)
      if (faces.at(i).text() == name) lampFace = i;
    if (lampFace == 6) lamp["face"].broken("is not among 'faces'");
    if (square.size() != 2) square.broken("is no range");
    low = square.at(0).number() / out.side;
    high = square.at(1).number() / out.side;
    if (!(0.0 < low && low < high && high < 1.0)) square.broken("lies not inside its face");
    lampEmission = lamp.number("emission");
    lampAlbedo = lamp.numberOr("albedo_of_lamp", albedo[lampFace]);
    out.cells = 4;
  }
  SceneBuilder b(out.cells);
  const auto faces = facesOfBox(glm::dvec3(out.side));
  for (std::size_t i = 0; i < 6; ++i) {
    const Face& f = faces[order[i]];
    const std::uint32_t wall = b.material(Rgb(float(albedo[i])), Rgb(radiance(emission[i])));
    const auto part = [&](double u0, double u1, double v0, double v1, std::uint32_t material) {
      const std::uint32_t object =
          b.quad(glm::vec3(f.origin + u0 * f.u + v0 * f.v), glm::vec3((u1 - u0) * f.u), glm::vec3((v1 - v0) * f.v), material);
      out.areas[i].resize(object + 1, 0.0);
      out.areas[i][object] = (u1 - u0) * (v1 - v0);
      if (u0 <= 0.5 && 0.5 < u1 && v0 <= 0.5 && 0.5 < v1) out.centres.push_back({object, (0.5 - u0) / (u1 - u0), (0.5 - v0) / (v1 - v0)});
    };
    if (i != lampFace) {
      part(0, 1, 0, 1, wall);
      continue;
    }
    part(low, high, low, high, b.material(Rgb(float(lampAlbedo)), Rgb(radiance(lampEmission))));
    part(0, low, 0, 1, wall);
    part(high, 1, 0, 1, wall);
    part(low, high, 0, low, wall);
    part(low, high, high, 1, wall);
  }
  out.scene = b.scene;
  return out;
}

BalanceRoom balanceRoom() {
  const double albedo[] = {0.2, 0.7, 0.5, 0.9, 0.35, 0.6}, emission[] = {0.0, 0.0, 0.0, 1.0, 0.0, 0.0};
  constexpr double kBoxAlbedo = 0.8;
  const glm::dvec3 size(3, 2, 4), boxSize(1, 1, 1), boxAt(1.25, 0, 1.5);
  BalanceRoom out;
  SceneBuilder b(4);
  const auto add = [&](const Face& f, double rho, double m) {
    b.quad(glm::vec3(f.origin), glm::vec3(f.u), glm::vec3(f.v), b.material(Rgb(float(rho)), Rgb(radiance(m))));
    out.areas.push_back(glm::length(f.u) * glm::length(f.v));
    out.albedo.push_back(rho);
    out.emission.push_back(m);
    out.sent += out.areas.back() * m;
  };
  const auto walls = facesOfBox(size);
  for (std::size_t i = 0; i < 6; ++i) add(walls[i], albedo[i], emission[i]);
  // It floats above the floor, so that each of its faces is seen; fronts outwards.
  for (Face f : facesOfBox(boxSize)) {
    f.origin += boxAt + glm::dvec3(0, 0.5, 0);
    std::swap(f.u, f.v);
    add(f, kBoxAlbedo, 0.0);
  }
  out.scene = b.scene;
  return out;
}

double absorbed(const BalanceRoom& room, const Baked& b) {
  double sum = 0.0;
  for (std::uint32_t i = 0; i < room.areas.size(); ++i) sum += room.areas[i] * (1.0 - room.albedo[i]) * b.mean(i).x;
  return sum;
}

}  // namespace lmc
