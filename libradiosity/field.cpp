#include "libradiosity/field.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "libradiosity/slopes.h"
#include "libscene/paging.h"
#include "libscene/parallel.h"
#include "libscene/sampling.h"
#include "libscene/texture.h"

namespace lmc {

namespace {

constexpr std::uint32_t kBurialRays = 8;
constexpr std::uint32_t kSkyRays = 64, kMostSkyRays = 1024;  // down to a goal of 2 %; at most
constexpr double kSkyPower = 1.5;                            // rays go with goal^-power below: Sobol points

/// A place on the patch (holes of Mask materials count as the rest), facing the patch's way.
SurfacePoint place(const Scene& scene, const PatchMesh& mesh, const Patch& patch, glm::vec2 u) {
  const auto [triangle, bary] = mesh.sample(patch, u);
  SurfacePoint p = surfacePoint(scene, triangle, bary);
  p.normal = p.geometricNormal;  // patches send and receive by their true faces: with bent normals energy would not balance
  if (patch.back) p.normal = p.geometricNormal = -p.geometricNormal;
  return p;
}

/// Patches of twice the size: by object, direction, size and cell of space.
PatchGroups coarseGroups(const PatchMesh& mesh) {
  std::unordered_map<std::uint64_t, std::uint32_t> cell;
  PatchGroups out;
  out.of.resize(mesh.patches.size());
  for (std::size_t i = 0; i < out.of.size(); ++i) {
    const Patch& p = mesh.patches[i];
    const glm::dvec3 c = glm::floor(p.centre_m / (2.0 * double(p.size_m))), n = glm::floor(2.0 * p.normal + 0.5);
    std::uint64_t key = combine(combine(p.object, p.back), p.level);
    for (int k = 0; k < 3; ++k) key = combine(key, combine(std::uint64_t(std::int64_t(c[k])), std::uint64_t(std::int64_t(n[k]))));
    const auto [it, fresh] = cell.try_emplace(key, out.count);
    if (fresh) ++out.count;
    out.of[i] = it->second;
  }
  return out;
}

}  // namespace

std::uint32_t DirectMap::texelAt(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) const {
  const Object& object = scene.objectOf(triangle);
  if (!illuminance || !object.receive || !object.inMap) return kNone;
  const glm::uvec3 t = scene.triangles[triangle];
  const glm::dvec2 w(bary);
  const glm::dvec2 p = (1.0 - w.x - w.y) * scene.mapPlace(object, t.x, width) + w.x * scene.mapPlace(object, t.y, width) +
                       w.y * scene.mapPlace(object, t.z, width);
  // A UV of exactly 1 lies in the last texel; what is farther out was refused with the charts.
  const int x = std::clamp(int(std::floor(p.x)), 0, width - 1), y = std::clamp(int(std::floor(p.y)), 0, height - 1);
  const std::size_t i = std::size_t(y) * std::size_t(width) + std::size_t(x);
  Paging::touched();
  // Where charts share a texel, only the one that has it may be read there.
  return chart[i] == kNone || chart[i] != charts->chartOf[triangle] ? kNone : std::uint32_t(i);
}

void exposePatches(PatchMesh& mesh, const Scene& scene, const Tracer& tracer, const Run& run) {
  parallelFor(run, mesh.patches.size(), 64, [&](std::size_t i) {
    Patch& patch = mesh.patches[i];
    const Sobol4 places = sequence(run.seed, Draw::PatchDirect, 0, 0, std::uint32_t(i), 0, 0);
    const Sobol4 directions = sequence(run.seed, Draw::PatchSky, 0, 0, std::uint32_t(i), 1, 0);
    std::uint32_t exposed = 0;
    patch.exposed = 0;
    patch.fronts = patch.backs = patch.left = 0;
    for (std::uint32_t k = 0; k < kPatchPlaces; ++k) {
      const glm::vec4 u = places.point(k);
      const SurfacePoint p = place(scene, mesh, patch, {u.z, u.w});
      bool buried = true, leaves = false, back = false;  // the last two: where the first ray went
      for (std::uint32_t r = 0; r < kBurialRays && buried; ++r) {
        // The first rays of all places are the sequence's first points, and each place's others follow each other: points at a stride of
        // 8 would all lie in one eighth of the square.
        const std::uint32_t index = r == 0 ? k : kPatchPlaces + k * kBurialRays + r - 1;
        const glm::dvec3 d = frameAbout(p.normal) * cosineHemisphere(directions.point2(index));
        const Hit hit = tracer.closest(Ray{tracer.lifted(p.position_m, p.geometricNormal), glm::vec3(d), INFINITY}, Purpose::Exposure);
        buried = hit && mesh.patchAt(hit.triangle, hit.bary, hit.front) == kNone;
        if (r == 0) leaves = !hit, back = buried;
      }
      if (buried) continue;
      patch.exposed = std::uint16_t(patch.exposed | 1u << k);
      ++exposed;
      ++(leaves ? patch.left : back ? patch.backs : patch.fronts);
    }
    patch.area_m2 *= double(exposed) / kPatchPlaces;
  });
}

PatchLight lightPatches(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const DirectLight& direct, const DirectMap& map,
                        const Run& run, std::uint32_t skyRays) {
  PatchLight out;
  out.direct.assign(mesh.patches.size(), Rgb(0.0f));
  out.sky.assign(mesh.patches.size(), Rgb(0.0f));
  const bool sky = strength(scene.sky) > 0.0f;
  parallelFor(run, mesh.patches.size(), 64, [&](std::size_t i) {
    const Patch& patch = mesh.patches[i];
    if (patch.exposed == 0) return;
    const Sobol4 numbers = sequence(run.seed, Draw::PatchDirect, 0, 0, std::uint32_t(i), 0, 0);
    std::vector<SurfacePoint> places;
    for (std::uint32_t k = 0; k < kPatchPlaces; ++k) {
      const glm::vec4 u = numbers.point(k);
      if (patch.exposed >> k & 1u) places.push_back(place(scene, mesh, patch, {u.z, u.w}));
    }
    if (direct.any()) {
      std::vector<SurfacePoint> unknown;
      glm::dvec3 sum(0.0);
      for (const SurfacePoint& p : places) {
        const Rgb* known = patch.back ? nullptr : map.at(scene, p.triangle, p.bary);
        if (known)
          sum += glm::dvec3(*known);
        else
          unknown.push_back(p);
      }
      if (!unknown.empty()) {
        const auto lights = direct.lightsFor(patch.centre_m, patch.radius_m);
        sum += double(unknown.size()) * direct.sample(unknown, lights, numbers).illuminance;
      }
      out.direct[i] = Rgb(sum / double(places.size()));
    }
    if (sky) {
      const Sobol4 directions = sequence(run.seed, Draw::PatchSky, 0, 0, std::uint32_t(i), 0, 0);
      std::vector<Ray> rays(skyRays);
      std::vector<std::uint8_t> blocked(skyRays);
      for (std::uint32_t k = 0; k < skyRays; ++k) {
        const SurfacePoint& p = places[k % places.size()];
        const glm::dvec3 d = frameAbout(p.normal) * cosineHemisphere(directions.point2(k));
        rays[k] = {tracer.lifted(p.position_m, p.geometricNormal), glm::vec3(d), INFINITY};
      }
      tracer.occluded(rays, blocked, Purpose::PatchSky);
      std::uint32_t open = 0;
      for (const std::uint8_t b : blocked) open += b == 0;
      out.sky[i] = float(kPi) * scene.sky * (float(open) / float(skyRays));
    }
  });
  return out;
}

std::uint32_t patchSkyRaysFor(double goal) {
  const double wish = kSkyRays * std::pow(0.02 / goal, kSkyPower);
  return std::uint32_t(std::clamp(std::ceil(wish / kPatchPlaces) * kPatchPlaces, double(kSkyRays), double(kMostSkyRays)));
}

struct Field::Parts {
  Parts(const Scene& scene, const PatchMesh& patchMesh, const DirectMap& map, const TexelMap& texels, const Run& run)
      : mesh(patchMesh),
        illuminance(map.illuminance),
        places(scene, patchMesh, texels, run),
        single(singlePatches(patchMesh)),
        group(coarseGroups(patchMesh)),
        fine(patchMesh, map, places, single),
        coarse(patchMesh, map, places, group) {}
  /// Of a texel that has a patch: the patch under its middle, with the texel's own direct light.
  Seen at(std::size_t texel, std::size_t half) const {
    const Patch& p = mesh.patches[places.patch[texel]];
    const Rgb& direct = illuminance[texel];
    return {p.reflectance * (direct + fine.at(fineLight[half], texel)), p.reflectance * (direct + coarse.at(coarseLight[half], texel)),
            p.size_m};
  }
  const PatchMesh& mesh;
  const Rgb* illuminance;
  TexelPatches places;
  PatchGroups single, group;
  Slopes fine, coarse;
  std::array<Sloped, 2> fineLight, coarseLight;  // sky and bounces, of each half
};

Field::~Field() = default;

Field::Field(const Scene& scene, const PatchMesh& mesh, const DirectMap& map, const TexelMap& texels, const PatchLight& light,
             std::array<const Bounced*, 2> solutions, const Bounced* coarser, const Run& run, bool compact)
    : scene_(scene), mesh_(mesh), map_(map), uvs_(scene.triangles.size()) {
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    const Object& object = scene.objectOf(t);
    if (!object.receive || !object.inMap) continue;
    const glm::uvec3 v = scene.triangles[t];
    const glm::dvec2 a = scene.mapPlace(object, v.x, map.width);
    uvs_[t] = {glm::vec2(a), glm::vec2(scene.mapPlace(object, v.y, map.width) - a), glm::vec2(scene.mapPlace(object, v.z, map.width) - a),
               map.charts->chartOf[t]};
  }
  parts_ = std::make_unique<Parts>(scene, mesh, map, texels, run);
  const auto withSky = [&](Bounced b) {
    for (std::size_t i = 0; i < b.size(); ++i) b[i] += light.sky[i];
    return b;
  };
  const std::vector<Rgb> coarseDirect = parts_->coarse.means(light.direct);
  for (std::size_t h = 0; h < 2; ++h) {
    parts_->fineLight[h] = parts_->fine.of(withSky(*solutions[h]));
    parts_->coarseLight[h] = parts_->coarse.of(parts_->coarse.means(withSky(coarser ? *coarser : *solutions[h])));
    for (std::size_t i = 0; i < mesh.patches.size(); ++i) {
      const Patch& p = mesh.patches[i];
      const std::uint32_t g = parts_->group.of[i];
      patches_[h].push_back({p.reflectance * (light.direct[i] + parts_->fineLight[h].mean[i]),
                             p.reflectance * (coarseDirect[g] + parts_->coarseLight[h].mean[g]), p.size_m});
    }
  }
  if (compact) return;
  for (std::size_t h = 0; h < 2; ++h) {
    texels_[h].assign(parts_->places.patch.size(), {});
    for (std::size_t i = 0; i < texels_[h].size(); ++i)
      if (parts_->places.patch[i] != kNone) texels_[h][i] = {parts_->at(i, h), map.chart[i]};
  }
  parts_.reset();
}

Field::Seen Field::at(const Hit& hit, int half) const {
  const auto h = std::size_t(half);
  if (const TriangleUv& t = uvs_[hit.triangle]; hit.front && t.chart != kNone) {
    const glm::vec2 uv = t.corner + hit.bary.x * t.e1 + hit.bary.y * t.e2;
    const int x = std::clamp(int(std::floor(uv.x)), 0, map_.width - 1), y = std::clamp(int(std::floor(uv.y)), 0, map_.height - 1);
    const std::size_t i = std::size_t(y) * std::size_t(map_.width) + std::size_t(x);
    // Else another chart has the texel.
    if (!parts_) {
      if (texels_[h][i].chart == t.chart) return texels_[h][i].seen;
    } else {
      Paging::touched();
      if (map_.chart[i] == t.chart && parts_->places.patch[i] != kNone) return parts_->at(i, h);
    }
  }
  const std::uint32_t id = mesh_.patchAt(hit.triangle, hit.bary, hit.front);
  return id == kNone ? Seen{} : patches_[h][id];
}

const Rgb* Field::reflectanceAt(const Hit& hit) const {
  const std::uint32_t id = mesh_.patchAt(hit.triangle, hit.bary, hit.front);
  return id == kNone ? nullptr : &mesh_.patches[id].reflectance;
}

const Rgb* Field::sureDirectAt(const Hit& hit) const {
  if (!hit.front) return nullptr;
  const std::uint32_t i = map_.texelAt(scene_, hit.triangle, hit.bary);
  return i == kNone || (map_.edge && map_.edge[i]) ? nullptr : map_.illuminance + i;
}

}  // namespace lmc
