#pragma once
/// A check of what a map states about its error, by unbiased path tracing of texels drawn by that error. It knows nothing of how the map
/// was made but what was stated: bounds that are too low by their own kind (what both halves share, what no term names) show here alone.
#include <array>
#include <cstdint>
#include <vector>

#include "libradiosity/light_map.h"
#include "libradiosity/path_tracer.h"

namespace lmc {

/// Why a texel may be hard.
enum class TexelClass : std::uint8_t { Edge, Contact, NearHit, Interpolated, Smooth };
inline constexpr std::array<const char*, 5> kTexelClassNames{"edge", "contact", "near-hit", "interpolated", "smooth"};
TexelClass classOf(const LightMap&, std::size_t texel);

struct AuditOptions {
  std::uint64_t rays = 0;  ///< at most
  PathOptions paths;
};

/// A mean square and a mean, with their standard errors.
struct Found {
  double square = 0.0, squareError = 0.0;  ///< of the difference from the truth, relative to the level's mean
  double bias = 0.0, biasError = 0.0;      ///< mean of map minus truth
  double rms() const { return std::sqrt(std::max(0.0, square)); }
  /// Ends of a confidence interval of the RMS: `z` standard errors. Of both ways to see an error the one that shows more.
  double low(double z) const;
  double high(double z) const;
};

struct AuditedClass {
  std::uint64_t texels = 0;  ///< of the level
  std::uint32_t drawn = 0;
  double stated = 0.0;  ///< RMS of what the map states, relative to the level's mean
  Found found;
};

struct AuditedTexel {
  std::size_t texel = 0;
  TexelClass kind = TexelClass::Smooth;
  double illuminance = 0.0;          ///< of the map, mean over channels [lx]
  double stated = 0.0, found = 0.0;  ///< error and difference, mean over channels [lx]
  double foundError = 0.0;           ///< standard error of it [lx]
};

struct AuditResult {
  std::uint32_t drawn = 0;  ///< texels; 0 = there was no audit
  std::uint64_t paths = 0, rays = 0;
  Found found;
  std::array<AuditedClass, kTexelClassNames.size()> classes;
  std::vector<AuditedTexel> worst;  ///< that differ most beyond what path tracing leaves open, largest first
  bool contradicts = false;         ///< what the ledger states as its bound
};

/// Texels are drawn class by class in proportion to `stated` (one a texel, lx: statedErrors()), and count by the reciprocal of their
/// chance. What they differ by is estimated by two independent streams of paths, whose product has no noise in its mean:
/// E[(v - a)(v - b)] = (v - E)^2. Deterministic: texels and paths by seed and counts. Where the least RMS that the audit allows (at 99 %)
/// is above ledger.bound95, `ledger` is raised to what was found.
AuditResult audit(const LightMap&, const LightMapValues&, const Scene&, const TexelMap&, const Tracer&, std::span<const float> stated,
                  const AuditOptions&, ErrorLedger& ledger, const Run&);

inline constexpr double kAuditGoal = 0.02;   ///< bakes with goals below are audited by themselves
inline constexpr double kAuditShare = 0.15;  ///< of the bake's rays, at most

}  // namespace lmc
