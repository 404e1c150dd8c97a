#pragma once
/// Small levels made in code, with the light maps' UVs laid out beside them: for tests and for reference cases.
#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>

#include "libscene/scene.h"

namespace lmc {

/// Quads become objects; each gets a square cell of the light map with a margin of a tenth.
class SceneBuilder {
 public:
  explicit SceneBuilder(int cellsPerSide = 4) : cells_(cellsPerSide) { scene.file = "test.glb"; }

  std::uint32_t material(Rgb reflectance, Rgb emission = Rgb(0.0f)) {
    Material m;
    m.baseColor = glm::vec4(reflectance, 1.0f);
    m.metallic = 0.0f;
    m.emission = emission;
    scene.materials.push_back(m);
    return std::uint32_t(scene.materials.size() - 1);
  }

  /// Corners origin, origin + u, origin + u + v, origin + v; the front is where cross(u, v) points to. Cut into `cuts` x `cuts` squares.
  std::uint32_t quad(glm::vec3 origin, glm::vec3 u, glm::vec3 v, std::uint32_t material, int cuts = 1) {
    const std::uint32_t object = addObject(material, true);
    const glm::vec3 n = glm::normalize(glm::cross(u, v));
    const float cell = 1.0f / float(cells_), margin = 0.1f * cell;
    const glm::vec2 corner(float(int(object) % cells_) * cell + margin, float(int(object) / cells_) * cell + margin);
    const auto first = std::uint32_t(scene.positions_m.size());
    for (int y = 0; y <= cuts; ++y)
      for (int x = 0; x <= cuts; ++x) {
        const float a = float(x) / float(cuts), b = float(y) / float(cuts);
        addVertex(origin + a * u + b * v, n, {a, b}, corner + (cell - 2.0f * margin) * glm::vec2(a, b));
      }
    const auto at = [&](int x, int y) { return first + std::uint32_t(y * (cuts + 1) + x); };
    for (int y = 0; y < cuts; ++y)
      for (int x = 0; x < cuts; ++x) {
        scene.triangles.emplace_back(at(x, y), at(x + 1, y), at(x + 1, y + 1));
        scene.triangles.emplace_back(at(x, y), at(x + 1, y + 1), at(x, y + 1));
      }
    finishObject();
    return object;
  }

  /// A flat polygon as a fan, fronts counter-clockwise; without a place in the light map.
  std::uint32_t polygon(std::span<const glm::dvec3> corners_m, std::uint32_t material) {
    const std::uint32_t object = addObject(material, false);
    const auto first = std::uint32_t(scene.positions_m.size());
    glm::dvec3 n(0.0);
    for (std::size_t i = 2; i < corners_m.size(); ++i) n += glm::cross(corners_m[i - 1] - corners_m[0], corners_m[i] - corners_m[0]);
    for (const glm::dvec3& c : corners_m) addVertex(glm::vec3(c), glm::vec3(glm::normalize(n)), glm::vec2(0.0f), glm::vec2(0.0f));
    for (std::uint32_t i = 2; i < corners_m.size(); ++i) scene.triangles.emplace_back(first, first + i - 1, first + i);
    finishObject();
    return object;
  }

  /// Any surface; its vertices' places in the light map are the caller's.
  std::uint32_t mesh(std::span<const glm::vec3> positions_m, std::span<const glm::vec3> normals, std::span<const glm::vec2> mapUv,
                     std::span<const glm::uvec3> triangles, std::uint32_t material) {
    const std::uint32_t object = addObject(material, true);
    const auto first = std::uint32_t(scene.positions_m.size());
    for (std::size_t i = 0; i < positions_m.size(); ++i) addVertex(positions_m[i], normals[i], glm::vec2(0.0f), mapUv[i]);
    for (const glm::uvec3& t : triangles) scene.triangles.push_back(first + t);
    finishObject();
    return object;
  }

  /// The six faces of a box, fronts inwards; materials in the order -x +x -y +y -z +z.
  void room(glm::vec3 lo, glm::vec3 hi, const std::array<std::uint32_t, 6>& m, int cuts = 1) {
    const glm::vec3 d = hi - lo;
    const glm::vec3 X(d.x, 0, 0), Y(0, d.y, 0), Z(0, 0, d.z);
    quad(lo, Y, Z, m[0], cuts);
    quad(lo + X, Z, Y, m[1], cuts);
    quad(lo, Z, X, m[2], cuts);
    quad(lo + Y, X, Z, m[3], cuts);
    quad(lo, X, Y, m[4], cuts);
    quad(lo + Z, Y, X, m[5], cuts);
  }

  Scene scene;

 private:
  std::uint32_t addObject(std::uint32_t material, bool inMap) {
    const auto object = std::uint32_t(scene.objects.size());
    Object o;
    o.name = "quad" + std::to_string(object);
    o.path = "/" + o.name;
    o.node = object;
    o.mesh = object;
    o.firstTriangle = std::uint32_t(scene.triangles.size());
    o.firstVertex = std::uint32_t(scene.positions_m.size());
    o.material = material;
    o.inMap = inMap;
    o.receive = inMap;
    scene.objects.push_back(o);
    return object;
  }
  void addVertex(const glm::vec3& position_m, const glm::vec3& normal, const glm::vec2& uv0, const glm::vec2& mapUv) {
    scene.positions_m.push_back(position_m);
    scene.normals.push_back(normal);
    scene.uv0.push_back(uv0);
    scene.sourceVertex.push_back(std::uint32_t(scene.positions_m.size() - 1) - scene.objects.back().firstVertex);
    scene.mapUv.push_back(mapUv);
    for (int k = 0; k < 3; ++k) scene.extent_m = std::max(scene.extent_m, std::abs(position_m[k]));
  }
  void finishObject() {
    Object& o = scene.objects.back();
    o.triangleCount = std::uint32_t(scene.triangles.size()) - o.firstTriangle;
    o.vertexCount = std::uint32_t(scene.positions_m.size()) - o.firstVertex;
    scene.triangleObject.resize(scene.triangles.size(), std::uint32_t(scene.objects.size() - 1));
  }

  int cells_;
};

/// Every face emits `radiance` and reflects `reflectance`: E = pi radiance/(1 - rho) everywhere.
inline Scene furnace(float reflectance, float radiance, glm::vec3 size = glm::vec3(3.0f, 2.0f, 4.0f), glm::vec3 at = glm::vec3(0.0f)) {
  SceneBuilder b;
  const std::uint32_t m = b.material(Rgb(reflectance), Rgb(radiance));
  b.room(at, at + size, {m, m, m, m, m, m});
  return b.scene;
}

}  // namespace lmc
