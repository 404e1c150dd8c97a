#pragma once
/// References: the truth at some texels, made by path tracing or given; and how far a map is from it.
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "lmc/options.h"

namespace lmc {

struct ReferenceWish {
  double error = 0.003;         ///< noise, RMS over the texels against their mean, that it may have
  std::uint32_t texels = 1024;  ///< that are drawn
  std::uint64_t rays = 0;       ///< at most, about
  bool openness = false;        ///< of ambient occlusion, cosine weighted, instead of illuminance
  std::string key;              ///< what it is made of: one that was begun with the same key is gone on with
};

/// Writes reference.exr (reference.000.exr, ... where there are several maps) and reference.json into `folder`. Channels: R G B A and
/// stderr.R/G/B as lightmap.exr has them (openness: Y, A and stderr.Y), A = 1 at the texels that were drawn: evenly over those that are
/// covered, and where the plan closes seams over those whose neighbours up to two texels away are of their chart, because closing moves the
/// others on purpose. Sums are kept in reference.state.json as it goes.
Exit makeReference(const BakeOptions&, const std::filesystem::path& folder, const ReferenceWish&);

/// Differences of a map from a reference over the reference's texels, against its mean there (openness, where black is dark enough: as they
/// are).
struct TrueError {
  std::uint64_t texels = 0;
  double rms = 0.0, net = 0.0;     ///< net: with the reference's own noise taken out
  double low = 0.0, high = 0.0;    ///< 95 % interval of net: other texels would have given another figure
  double noise = 0.0, bias = 0.0;  ///< the reference's; mean difference
  double mean = 0.0;
};
/// Files of a map and of its reference, in order. Throws Error Io or Broken where a channel is missing or sizes differ.
TrueError trueError(const std::vector<std::filesystem::path>& maps, const std::vector<std::filesystem::path>& references, bool openness);

/// Names of a set of maps: "STEM.exr", or "STEM.000.exr" ... when there are several.
std::vector<std::string> namesOfMaps(const std::string& stem, std::size_t count);

}  // namespace lmc
