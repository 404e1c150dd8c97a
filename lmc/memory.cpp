#include "lmc/memory.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "libradiosity/patch_mesh.h"
#include "libradiosity/solve.h"
#include "libscene/parallel.h"

namespace lmc {

namespace {

// Bytes, measured as peaks of bakes of cornell, gallery and atrium at 256 to 2048 texels a side (docs/stages.md), rounded up.
constexpr std::uint64_t kProgram = 20 << 20, kThread = 1 << 20;
constexpr std::uint64_t kTexel = 212;           // state of the map, what hemisphere rays see, cells and guides
constexpr std::uint64_t kTexelCompact = 176;    // the same with the field's texels put together at each hit
constexpr std::uint64_t kTexelSolve = 64;       // when stored rays are there
constexpr std::uint64_t kTriangle = 140;        // ray tracer, charts, places of texels
constexpr std::uint64_t kTriangleJoined = 180;  // where it has neighbours: patches, seams
constexpr std::uint64_t kPatch = 1500;          // faces, clusters, solutions
constexpr double kPatchesPerSquare = 3.0;
constexpr double kSquaresAtTwoPercent = 3000.0;
constexpr std::uint64_t kPatchOfLinks = 3000;  // 25 links a patch, those of the round before beside them
constexpr std::uint64_t kDensePair = 12;
constexpr std::uint64_t kMostTiles = 512 << 20;  // that are kept
// Of texels' state, when it lies in files: what is in work, and what stays in memory of each texel (cells, pools).
constexpr std::uint64_t kWindow = 96 << 20, kTexelStays = 16;
// Without --memory: so much, or if the level takes more, so much beside it.
constexpr std::uint64_t kUnasked = 960 << 20, kUnaskedWindow = 256 << 20;

template <class T>
std::uint64_t bytes(const std::vector<T>& v) {
  return v.size() * sizeof(T);
}

}  // namespace

double squaresFor(double goal) {
  // Rays grow as goal^-1.43: below 2 % patches grow as fast, or what they leave would take a larger and larger part of the goal.
  return kSquaresAtTwoPercent * std::pow(0.02 / goal, goal < 0.02 ? 1.5 : 1.0);
}

MemoryPlan planMemory(const Scene& scene, const BakeOptions& o, int side, int maps, bool bounce, bool seams, std::uint64_t machine_bytes) {
  std::uint64_t level = bytes(scene.positions_m) + bytes(scene.normals) + bytes(scene.uv0) + bytes(scene.uv1) + bytes(scene.mapUv) +
                        bytes(scene.sourceVertex) + bytes(scene.colors) + bytes(scene.triangles) + bytes(scene.triangleObject) +
                        (kTriangle + (bounce || seams ? kTriangleJoined : 0)) * scene.triangles.size();
  for (const auto& image : scene.images) level += 4 * std::uint64_t(image.width) * std::uint64_t(image.height);
  const std::uint64_t texels = std::uint64_t(side) * std::uint64_t(side) * std::uint64_t(maps);
  std::uint64_t patches = 0;
  if (bounce && !scene.triangles.empty()) {
    double squares = squaresFor(o.goal);
    if (o.patchSize_m > 0.0) squares = std::pow(patchSizeFor_m(scene, 1.0) / o.patchSize_m, 2.0);
    patches = std::uint64_t(std::min(kPatchesPerSquare * squares, double(o.maxPatches)));
  }
  std::uint64_t solver = patches * kPatch;
  if (o.solver == Solver::Hierarchical) solver += patches * kPatchOfLinks;
  const std::uint64_t dense = std::min<std::uint64_t>(patches, kMaxDensePatches);
  if (o.solver == Solver::Dense) solver += kDensePair * dense * dense;
  const std::uint64_t base = kProgram + kThread * std::uint64_t(threadCount(Run{o.threads})) + level + solver;
  MemoryPlan out;
  out.limit_bytes = o.memory_bytes > 0 ? o.memory_bytes : machine_bytes;
  out.texels_bytes = kTexel * texels;
  out.wanted_bytes = base + out.texels_bytes;
  const std::uint64_t window = kWindow + (bounce ? kTexelStays * texels : 0);
  out.least_bytes = base + std::min(kTexelCompact * texels, window);
  out.held_bytes = o.memory_bytes > 0 ? o.memory_bytes : std::min(machine_bytes, std::max(kUnasked, base + kUnaskedWindow));
  // Half of what is to spare: the more so as the rest of the machine wants something, too.
  const std::uint64_t taken = out.paged() ? out.least_bytes : out.wanted_bytes;
  out.tiles_bytes = out.held_bytes > taken ? std::min(kMostTiles, (out.held_bytes - taken) / 2) : 0;
  const std::uint64_t room = out.paged() ? out.held_bytes : out.limit_bytes,
                      beside = base + std::min(kTexelSolve * texels, out.paged() ? window : kTexelSolve * texels) + out.tiles_bytes;
  out.rays_bytes = room > beside ? room - beside : 0;
  return out;
}

std::optional<std::uint64_t> bytesOf(std::string_view text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc()) return std::nullopt;
  const std::string_view unit = text.substr(std::size_t(end - text.data()));
  constexpr std::string_view kUnits = "KMGT";
  if (unit.size() > 1) return std::nullopt;
  if (!unit.empty()) {
    const std::size_t power = kUnits.find(unit[0]);
    if (power == std::string_view::npos) return std::nullopt;
    value = std::ldexp(value, 10 * (int(power) + 1));
  }
  if (!(value >= 1.0) || !(value < 0x1p63)) return std::nullopt;
  return std::uint64_t(value);
}

std::string sizeText(const MemoryPlan& m) {
  return sizeText(m.peak_bytes()) + " of memory" + (m.paged() ? fmt::format(" and {} of disk", sizeText(m.disk_bytes())) : std::string());
}

std::string sizeText(std::uint64_t bytes) { return fmt::format("{}M", (bytes + (1 << 20) - 1) >> 20); }

}  // namespace lmc
