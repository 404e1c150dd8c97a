#include "libradiosity/field.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "libradiosity/slopes.h"
#include "libscene/parallel.h"
#include "libscene/sampling.h"
#include "libscene/texture.h"

namespace lmc {

namespace {

constexpr std::uint32_t kBurialRays = 8;
constexpr std::uint32_t kSkyRays = 64;

/// A place on the patch (holes of Mask materials count as the rest), facing the patch's way.
SurfacePoint place(const Scene& scene, const PatchMesh& mesh, const Patch& patch, glm::vec2 u) {
  const auto [triangle, bary] = mesh.sample(patch, u);
  SurfacePoint p = surfacePoint(scene, triangle, bary);
  p.normal = p.geometricNormal;  // patches send and receive by their true faces: with bent normals energy would not balance
  if (patch.back) p.normal = p.geometricNormal = -p.geometricNormal;
  return p;
}

/// Patches of twice the size: by object, direction, size and cell of space.
std::vector<std::uint32_t> coarseGroups(const PatchMesh& mesh, std::uint32_t& count) {
  std::unordered_map<std::uint64_t, std::uint32_t> cell;
  std::vector<std::uint32_t> group(mesh.patches.size());
  count = 0;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const Patch& p = mesh.patches[i];
    const glm::dvec3 c = glm::floor(p.centre_m / (2.0 * double(p.size_m))), n = glm::floor(2.0 * p.normal + 0.5);
    std::uint64_t key = combine(combine(p.object, p.back), p.level);
    for (int k = 0; k < 3; ++k) key = combine(key, combine(std::uint64_t(std::int64_t(c[k])), std::uint64_t(std::int64_t(n[k]))));
    const auto [it, fresh] = cell.try_emplace(key, count);
    if (fresh) ++count;
    group[i] = it->second;
  }
  return group;
}

std::vector<Rgb> groupMeans(const PatchMesh& mesh, const std::vector<std::uint32_t>& group, std::uint32_t count,
                            const std::vector<Rgb>& values) {
  std::vector<glm::dvec3> sum(count, glm::dvec3(0.0));
  std::vector<double> area(count, 0.0);
  for (std::size_t i = 0; i < values.size(); ++i) {
    sum[group[i]] += mesh.patches[i].area_m2 * glm::dvec3(values[i]);
    area[group[i]] += mesh.patches[i].area_m2;
  }
  std::vector<Rgb> out(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) out[i] = area[group[i]] > 0.0 ? Rgb(sum[group[i]] / area[group[i]]) : values[i];
  return out;
}

}  // namespace

std::uint32_t DirectMap::texelAt(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) const {
  const Object& object = scene.objectOf(triangle);
  if (!illuminance || !object.receive || !object.hasUv1) return kNone;
  const glm::uvec3 t = scene.triangles[triangle];
  const glm::vec2 uv = (1.0f - bary.x - bary.y) * scene.uv1[t.x] + bary.x * scene.uv1[t.y] + bary.y * scene.uv1[t.z];
  // A UV of exactly 1 lies in the last texel; what is farther out was refused with the charts.
  const int x = std::clamp(int(std::floor(uv.x * float(width))), 0, width - 1),
            y = std::clamp(int(std::floor(uv.y * float(height))), 0, height - 1);
  const std::size_t i = std::size_t(y) * std::size_t(width) + std::size_t(x);
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
                        const Run& run) {
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
      std::array<Ray, kSkyRays> rays;
      std::array<std::uint8_t, kSkyRays> blocked;
      for (std::uint32_t k = 0; k < kSkyRays; ++k) {
        const SurfacePoint& p = places[k % places.size()];
        const glm::dvec3 d = frameAbout(p.normal) * cosineHemisphere(directions.point2(k));
        rays[k] = {tracer.lifted(p.position_m, p.geometricNormal), glm::vec3(d), INFINITY};
      }
      tracer.occluded(rays, blocked, Purpose::PatchSky);
      std::uint32_t open = 0;
      for (const std::uint8_t b : blocked) open += b == 0;
      out.sky[i] = float(kPi) * scene.sky * (float(open) / float(kSkyRays));
    }
  });
  return out;
}

Field::Field(const Scene& scene, const PatchMesh& mesh, const DirectMap& map, const TexelMap* texels, const PatchLight& light,
             std::array<const Bounced*, 2> solutions, const Bounced* coarser, const Run& run)
    : scene_(scene), mesh_(mesh), map_(map), uvs_(scene.triangles.size()) {
  std::uint32_t count = 0;
  const std::vector<std::uint32_t> group = coarseGroups(mesh, count);
  const std::vector<Rgb> coarseDirect = groupMeans(mesh, group, count, light.direct);
  std::array<std::vector<Rgb>, 2> indirect, coarseIndirect;  // sky and bounces
  for (std::size_t h = 0; h < 2; ++h) {
    indirect[h] = *solutions[h];
    for (std::size_t i = 0; i < indirect[h].size(); ++i) indirect[h][i] += light.sky[i];
    if (coarser) {
      coarseIndirect[h] = *coarser;
      for (std::size_t i = 0; i < coarser->size(); ++i) coarseIndirect[h][i] += light.sky[i];
    }
    coarseIndirect[h] = groupMeans(mesh, group, count, coarser ? coarseIndirect[h] : indirect[h]);
    for (std::size_t i = 0; i < mesh.patches.size(); ++i) {
      const Rgb rho = mesh.patches[i].reflectance;
      patches_[h].push_back(
          {rho * (light.direct[i] + indirect[h][i]), rho * (coarseDirect[i] + coarseIndirect[h][i]), mesh.patches[i].size_m});
    }
  }
  if (!texels || !map) return;
  for (auto& t : texels_) t.resize(std::size_t(map.width) * std::size_t(map.height));
  const glm::vec2 size(map.width, map.height);
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    if (!scene.objectOf(t).receive || !scene.objectOf(t).hasUv1) continue;
    const glm::uvec3 v = scene.triangles[t];
    uvs_[t] = {size * scene.uv1[v.x], size * (scene.uv1[v.y] - scene.uv1[v.x]), size * (scene.uv1[v.z] - scene.uv1[v.x]),
               map.charts->chartOf[t]};
  }
  const Slopes slopes(scene, mesh, map, *texels, run);
  for (std::size_t h = 0; h < 2; ++h) {
    const std::vector<Rgb> fine = slopes.overTexels(indirect[h]);
    for (std::size_t i = 0; i < fine.size(); ++i) {
      const std::uint32_t id = slopes.patchOf()[i];
      if (id == kNone) continue;
      const Patch& p = mesh.patches[id];
      // The coarse copy lies as flat as patches do: what slopes mend is a measure of what they leave.
      texels_[h][i] = {
          {p.reflectance * (map.illuminance[i] + fine[i]), p.reflectance * (map.illuminance[i] + coarseIndirect[h][id]), p.size_m},
          map.chart[i]};
    }
  }
}

Field::Seen Field::at(const Hit& hit, int half) const {
  const auto h = std::size_t(half);
  if (const TriangleUv& t = uvs_[hit.triangle]; hit.front && t.chart != kNone) {
    const glm::vec2 uv = t.corner + hit.bary.x * t.e1 + hit.bary.y * t.e2;
    const int x = std::clamp(int(std::floor(uv.x)), 0, map_.width - 1), y = std::clamp(int(std::floor(uv.y)), 0, map_.height - 1);
    const TexelSeen& texel = texels_[h][std::size_t(y) * std::size_t(map_.width) + std::size_t(x)];
    if (texel.chart == t.chart) return texel.seen;  // else another chart has the texel
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
