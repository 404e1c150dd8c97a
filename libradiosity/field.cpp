#include "libradiosity/field.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <unordered_set>

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

/// Patches of twice the size: by object, direction and cell of space.
std::vector<std::uint32_t> coarseGroups(const PatchMesh& mesh, std::uint32_t& count) {
  std::unordered_map<std::uint64_t, std::uint32_t> cell;
  std::vector<std::uint32_t> group(mesh.patches.size());
  count = 0;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const Patch& p = mesh.patches[i];
    const glm::dvec3 c = glm::floor(p.centre_m / (2.0 * mesh.size_m)), n = glm::floor(2.0 * p.normal + 0.5);
    std::uint64_t key = combine(p.object, p.back);
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

/// How a value changes over a patch, by least squares from the patches beside it: a patch's mean alone makes what is seen beyond the
/// nearest part of a wall too dark by what that part is darker.
class Slopes {
 public:
  /// `patchOf`: one a texel; patches that meet in neighbour texels of a chart are neighbours.
  Slopes(const PatchMesh& mesh, const DirectMap& map, const std::vector<std::uint32_t>& patchOf) : mesh_(mesh), sums_(mesh.patches.size()) {
    std::unordered_set<std::uint64_t> known;
    const auto meet = [&](std::size_t i, std::size_t k) {
      const std::uint32_t a = patchOf[i], b = patchOf[k];
      if (a == b || a == kNone || b == kNone || map.chart[i] != map.chart[k]) return;
      if (known.insert((std::uint64_t(std::min(a, b)) << 32) | std::max(a, b)).second) pairs_.push_back({a, b});
    };
    for (int y = 0; y < map.height; ++y)
      for (int x = 0; x < map.width; ++x) {
        const std::size_t i = std::size_t(y) * std::size_t(map.width) + std::size_t(x);
        if (x + 1 < map.width) meet(i, i + 1);
        if (y + 1 < map.height) meet(i, i + std::size_t(map.width));
      }
    for (const auto& [a, b] : pairs_) {
      add(a, b);
      add(b, a);
    }
    for (Sum& s : sums_) {
      const double trace = s.moment[0][0] + s.moment[1][1] + s.moment[2][2];
      if (!(trace > 0.0)) continue;
      // Neighbours along one line say nothing of the other direction: there the slope is none.
      s.inverse = glm::inverse(s.moment + kRidge * trace * glm::dmat3(1.0));
      s.known = true;
    }
  }

  /// Change of `values` per metre, a column a channel.
  std::vector<glm::mat3> of(const std::vector<Rgb>& values) const {
    std::vector<glm::dmat3> right(values.size(), glm::dmat3(0.0));
    const auto add = [&](std::uint32_t a, std::uint32_t b) {
      const glm::dvec3 d = mesh_.patches[b].centre_m - mesh_.patches[a].centre_m, v = glm::dvec3(values[b]) - glm::dvec3(values[a]);
      for (int c = 0; c < 3; ++c) right[a][c] += v[c] * d;
    };
    for (const auto& [a, b] : pairs_) {
      add(a, b);
      add(b, a);
    }
    std::vector<glm::mat3> out(values.size(), glm::mat3(0.0f));
    for (std::size_t i = 0; i < values.size(); ++i)
      if (sums_[i].known)
        for (int c = 0; c < 3; ++c) out[i][c] = glm::vec3(sums_[i].inverse * right[i][c]);
    return out;
  }

 private:
  static constexpr double kRidge = 0.02;
  struct Sum {
    glm::dmat3 moment{0.0}, inverse{0.0};
    bool known = false;
  };
  void add(std::uint32_t a, std::uint32_t b) {
    const glm::dvec3 d = mesh_.patches[b].centre_m - mesh_.patches[a].centre_m;
    sums_[a].moment += glm::outerProduct(d, d);
  }
  const PatchMesh& mesh_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs_;
  std::vector<Sum> sums_;
};

/// mean + slope * offset, between nothing and twice the mean.
Rgb sloped(const Rgb& mean, const glm::mat3& slope, const glm::vec3& offset) {
  const Rgb value = mean + Rgb(glm::dot(slope[0], offset), glm::dot(slope[1], offset), glm::dot(slope[2], offset));
  return glm::clamp(value, Rgb(0.0f), 2.0f * mean);
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
      patches_[h].push_back({rho * (light.direct[i] + indirect[h][i]), rho * (coarseDirect[i] + coarseIndirect[h][i])});
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
  std::vector<std::uint32_t> patchOf(texels_[0].size(), kNone);
  std::vector<glm::vec3> offset_m(texels_[0].size(), glm::vec3(0.0f));  // from the patch's centre to the texel's middle
  parallelFor(run, texels->tileCount(), 1, [&](std::size_t tileIndex) {
    const TexelTile tile = texels->texels(tileIndex);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        if (tile.at(x, y).fragmentCount == 0) continue;
        const SurfacePoint p = TexelSampler(scene, tile, tile.at(x, y)).at({0.5f, 0.5f});
        const std::size_t i = std::size_t(tile.y0 + y) * std::size_t(map.width) + std::size_t(tile.x0 + x);
        patchOf[i] = mesh.patchAt(p.triangle, p.bary, true);
        if (patchOf[i] != kNone) offset_m[i] = glm::vec3(p.position_m - mesh.patches[patchOf[i]].centre_m);
      }
  });
  const Slopes slopes(mesh, map, patchOf);
  for (std::size_t h = 0; h < 2; ++h) {
    const std::vector<glm::mat3> slope = slopes.of(indirect[h]);
    for (std::size_t i = 0; i < patchOf.size(); ++i) {
      const std::uint32_t id = patchOf[i];
      if (id == kNone) continue;
      const Rgb rho = mesh.patches[id].reflectance;
      const Rgb fine = sloped(indirect[h][id], slope[id], offset_m[i]);
      // The coarse copy lies as flat as patches do: what slopes mend is a measure of what they leave.
      texels_[h][i] = {{rho * (map.illuminance[i] + fine), rho * (map.illuminance[i] + coarseIndirect[h][id])}, map.chart[i]};
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
