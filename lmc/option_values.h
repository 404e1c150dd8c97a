#pragma once
/// Texts of the command line as values. What is none ends with exit code 1 and names the option; numbers are read alike in every locale.
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libradiosity/partition.h"
#include "libscene/scene.h"

namespace lmc {

/// What every refusal of the command line ends with.
inline constexpr const char* kSeeHelp = " (lmc --help, lmc VERB --help)";

/// Of an error: "2%" or "0.02"; above 0.
double shareOf(const std::string& text, const char* option);

/// --time: "90", "90s", "2m" or "1h" [s]; above 0.
double secondsOf(const std::string& text);

/// --partition: "auto", "all", "none" or a list of kRuleNames.
PartitionOptions partitionOf(const std::string& text);

/// --passes: "auto", which is 0, or a whole number of 1 or more.
int passesOf(const std::string& text);

/// --sky: "scene", which is none, "none", which is black, or a radiance R,G,B [cd/m^2].
std::optional<Rgb> skyOf(const std::string& text);

/// --explain: X,Y or X,Y,MAP.
std::array<int, 3> texelOf(const std::string& text);

/// --memory: "512M" [bytes].
std::uint64_t memoryOf(const std::string& text);

/// --ladder: rungs from coarse to fine, of errors in percent (`shares`) or of whole numbers (`counts`); none without a text.
std::vector<double> ladderOf(const std::string& text, bool shares, bool counts);

}  // namespace lmc
