#include "lmc/shade.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "libradiosity/emitters.h"
#include "libscene/constants.h"
#include "libscene/exr.h"
#include "libscene/image_file.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/texels.h"
#include "libscene/texture.h"
#include "libscene/tracer.h"
#include "lmc/bake.h"

namespace lmc {

namespace {

constexpr int kSamples = 16;           // per pixel
constexpr double kBrightShare = 0.95;  // this share of the pixels is darker than display white when the exposure is chosen here
constexpr double kWhite = 0.85;

struct Map {
  ExrImage image;
  float scale = 1.0f;
  Rgb texel(int x, int y) const {
    x = std::clamp(x, 0, image.width - 1);
    y = std::clamp(y, 0, image.height - 1);
    const std::size_t i = std::size_t(y) * std::size_t(image.width) + std::size_t(x);
    return scale * Rgb(image.channels.at("R")[i], image.channels.at("G")[i], image.channels.at("B")[i]);
  }
  /// Bilinear about texel centres.
  Rgb at(glm::vec2 uv) const {
    const glm::vec2 p = uv * glm::vec2(image.width, image.height) - 0.5f, f = glm::floor(p), w = p - f;
    const int x = int(f.x), y = int(f.y);
    return glm::mix(glm::mix(texel(x, y), texel(x + 1, y), w.x), glm::mix(texel(x, y + 1), texel(x + 1, y + 1), w.x), w.y);
  }
};

Camera cameraOf(const Scene& scene, const std::string& wish) {
  for (const Camera& c : scene.cameras)
    if (wish.empty() || c.name == wish) return c;
  glm::dvec3 eye(0.0), target(0.0);
  double fov_deg = 60.0;
  if (!wish.empty()) {
    double v[7];
    char end = 0;
    if (std::sscanf(wish.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf,%lf%c", v, v + 1, v + 2, v + 3, v + 4, v + 5, v + 6, &end) != 7 ||
        !(v[6] > 0.0 && v[6] < 180.0))
      throw Error(Exit::Usage, "lmc", "", fmt::format("--camera: '{}' is neither a camera of the level nor px,py,pz,tx,ty,tz,fov", wish));
    eye = glm::dvec3(v[0], v[1], v[2]) - scene.centre_m;
    target = glm::dvec3(v[3], v[4], v[5]) - scene.centre_m;
    fov_deg = v[6];
  } else {
    glm::dvec3 lo(1e300), hi(-1e300);
    for (const glm::vec3& p : scene.positions_m) {
      lo = glm::min(lo, glm::dvec3(p));
      hi = glm::max(hi, glm::dvec3(p));
    }
    eye = glm::mix(lo, hi, glm::dvec3(0.9, 0.6, 0.9));  // from inside the bounds: rooms are seen from within
    target = glm::mix(lo, hi, glm::dvec3(0.2, 0.35, 0.2));
  }
  Camera c;
  c.position_m = eye;
  const glm::dvec3 back = glm::normalize(eye - target);
  const glm::dvec3 up = std::abs(back.y) > 0.999 ? glm::dvec3(0, 0, 1) : glm::dvec3(0, 1, 0);
  const glm::dvec3 right = glm::normalize(glm::cross(up, back));
  c.axes = glm::dmat3(right, glm::cross(back, right), back);
  c.verticalFov_rad = fov_deg * kPi / 180.0;
  return c;
}

std::uint8_t encoded(double linear) {
  const double v = std::clamp(linear, 0.0, 1.0);
  const double s = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
  return std::uint8_t(std::lround(255.0 * s));
}

}  // namespace

nlohmann::json readSidecar(const std::filesystem::path& folder) {
  const std::vector<std::uint8_t> sidecarText = readFile(folder / "level.lmc.json");
  const auto sidecar = nlohmann::json::parse(sidecarText, nullptr, false);
  if (sidecar.is_discarded() || !sidecar.contains("files"))
    throw Error(Exit::Broken, folder / "level.lmc.json", "", "is not a sidecar of lmc");
  for (const auto& f : sidecar["files"]) {
    const auto name = f.value("name", std::string());
    if (name.empty() || name.find('/') != std::string::npos || contentHash(readFile(folder / name)) != f.value("xxh3", std::string()))
      throw Error(Exit::Broken, folder / name, "", "is not the file that the sidecar speaks of: bake again", "LMC_HASH");
  }
  return sidecar;
}

Exit shade(const ShadeOptions& options) {
  const Run run = stoppableRun(options.threads);
  const nlohmann::json sidecar = readSidecar(options.out);
  const Scene scene = loadLevel(options.out / "level.glb", {}, run);
  std::vector<Map> maps;
  for (const auto& m : sidecar.value("maps", nlohmann::json::array())) {
    const std::filesystem::path file = options.out / m.value("file", std::string());
    Map& map = maps.emplace_back(Map{readExr(file), 1.0f});
    if (!map.image.channels.contains("R") || !map.image.channels.contains("G") || !map.image.channels.contains("B"))
      throw Error(Exit::Broken, file, "", "has no channels R, G, B");
    if (const auto s = map.image.attributes.find("lmcScale"); s != map.image.attributes.end()) map.scale = s->second;
  }
  for (const Object& o : scene.objects)
    if (o.map >= maps.size()) throw Error(Exit::Broken, options.out / "level.lmc.json", "/maps", "lacks a map that the level names");

  const Camera camera = cameraOf(scene, options.camera);
  const Tracer tracer(scene);
  Image<glm::dvec3> radiance(options.width, options.height);
  const double tangent = std::tan(0.5 * camera.verticalFov_rad);
  withThreads(run, [&] {
    parallelFor(run, std::size_t(options.height), 1, [&](std::size_t row) {
      for (int x = 0; x < options.width; ++x) {
        const int y = int(row);
        const Sobol4 numbers(combine(std::uint64_t(y) << 32 | std::uint64_t(x), 0xca3e7a));
        std::array<Ray, kSamples> rays;
        std::array<Hit, kSamples> hits;
        for (std::uint32_t k = 0; k < kSamples; ++k) {
          const glm::vec2 u = numbers.point2(k);
          const double sx = (2.0 * (x + double(u.x)) / options.width - 1.0) * tangent * options.width / options.height;
          const double sy = (1.0 - 2.0 * (y + double(u.y)) / options.height) * tangent;
          rays[k] = {glm::vec3(camera.position_m), glm::vec3(camera.axes * glm::dvec3(sx, sy, -1.0)), INFINITY};
        }
        tracer.closest(rays, hits, Purpose::Camera);
        glm::dvec3 sum(0.0);
        for (const Hit& hit : hits) {
          if (!hit) {
            sum += glm::dvec3(scene.sky);
            continue;
          }
          if (!hit.front && !scene.materialOf(hit.triangle).doubleSided) continue;
          const glm::uvec3 t = scene.triangles[hit.triangle];
          const glm::vec2 uv =
              (1.0f - hit.bary.x - hit.bary.y) * scene.mapUv[t.x] + hit.bary.x * scene.mapUv[t.y] + hit.bary.y * scene.mapUv[t.z];
          if (scene.objectOf(hit.triangle).receive)
            sum += glm::dvec3(reflectanceAt(scene, hit.triangle, hit.bary) * maps[scene.objectOf(hit.triangle).map].at(uv)) / kPi;
          sum += glm::dvec3(emissionAt(scene, hit.triangle, hit.bary));
        }
        radiance.at(x, y) = sum / double(kSamples);
      }
    });
  });

  double exposure = options.exposure;
  if (!(exposure > 0.0)) {
    std::vector<double> values;
    for (const glm::dvec3& p : radiance.pixels) values.push_back(std::max({p.x, p.y, p.z}));
    const auto nth = values.begin() + std::ptrdiff_t(kBrightShare * double(values.size() - 1));
    std::nth_element(values.begin(), nth, values.end());
    exposure = *nth > 0.0 ? kWhite / *nth : 1.0;
  }
  Image<glm::u8vec4> picture(options.width, options.height);
  for (std::size_t i = 0; i < picture.pixels.size(); ++i) {
    const glm::dvec3 c = exposure * radiance.pixels[i];
    picture.pixels[i] = {encoded(c.x), encoded(c.y), encoded(c.z), 255};
  }
  const std::vector<std::uint8_t> png = encodePng(picture, false);
  writeFileWhole(options.picture, {reinterpret_cast<const char*>(png.data()), png.size()});
  return Exit::Done;
}

}  // namespace lmc
