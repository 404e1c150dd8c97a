#include "lmc/option_values.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

#include "libscene/error.h"
#include "lmc/memory.h"

namespace lmc {

namespace {

/// f(part) for what stands between commas.
template <class F>
void forParts(std::string_view text, F&& f) {
  for (std::size_t at = 0;;) {
    const std::size_t comma = text.find(',', at);
    f(text.substr(at, comma == std::string_view::npos ? comma : comma - at));
    if (comma == std::string_view::npos) return;
    at = comma + 1;
  }
}

[[noreturn]] void refuseOption(std::string_view option, std::string_view why) {
  throw Error(Exit::Usage, "lmc", "", fmt::format("{}: {}{}", option, why, kSeeHelp));
}

/// A whole text as a finite number.
std::optional<double> number(std::string_view text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

/// So many numbers with commas between; `form` says what is expected.
std::vector<double> numbers(std::string_view text, std::size_t count, const char* option, const char* form) {
  std::vector<double> out;
  forParts(text, [&](std::string_view part) {
    const auto value = number(part);
    if (!value) refuseOption(option, fmt::format("'{}' is not {}", text, form));
    out.push_back(*value);
  });
  if (out.size() != count) refuseOption(option, fmt::format("'{}' is not {}", text, form));
  return out;
}

bool isWhole(double value) { return value == std::floor(value); }

}  // namespace

double shareOf(const std::string& text, const char* option) {
  const bool percent = text.ends_with('%');
  const auto value = number(std::string_view(text).substr(0, text.size() - percent));
  if (!value || !(*value > 0.0)) refuseOption(option, fmt::format("'{}' is not an error such as 2% or 0.02", text));
  return percent ? *value / 100.0 : *value;
}

double secondsOf(const std::string& text) {
  const double unit = text.ends_with('h') ? 3600.0 : text.ends_with('m') ? 60.0 : 1.0;
  const bool named = unit > 1.0 || text.ends_with('s');
  const auto value = number(std::string_view(text).substr(0, text.size() - named));
  if (!value || !(*value > 0.0)) refuseOption("--time", fmt::format("'{}' is not a time such as 90s or 2m", text));
  return *value * unit;
}

PartitionOptions partitionOf(const std::string& text) {
  PartitionOptions out;
  if (text == "auto") return out;
  out.automatic = false;
  out.on.fill(text == "all");
  if (text == "all" || text == "none") return out;
  forParts(text, [&](std::string_view name) {
    const auto rule = std::ranges::find(kRuleNames, name);
    if (rule == kRuleNames.end())
      refuseOption("--partition", fmt::format("'{}' is not auto, all, none or one of facing, cells, empty, blocked", name));
    out.on[std::size_t(rule - kRuleNames.begin())] = true;
  });
  return out;
}

int passesOf(const std::string& text) {
  if (text == "auto") return 0;
  const auto value = number(text);
  if (!value || *value < 1.0 || *value > 1e6 || !isWhole(*value))
    refuseOption("--passes", fmt::format("'{}' is neither auto nor a whole number of 1 or more", text));
  return int(*value);
}

std::optional<Rgb> skyOf(const std::string& text) {
  if (text == "scene") return std::nullopt;
  if (text == "none") return Rgb(0.0f);
  const std::vector<double> v = numbers(text, 3, "--sky", "none, scene or a radiance R,G,B");
  if (std::ranges::min(v) < 0.0) refuseOption("--sky", "a radiance cannot be negative");
  return Rgb(float(v[0]), float(v[1]), float(v[2]));
}

std::array<int, 3> texelOf(const std::string& text) {
  const std::size_t count = std::ranges::count(text, ',') == 2 ? 3 : 2;
  const std::vector<double> v = numbers(text, count, "--explain", "a texel X,Y or X,Y,MAP");
  std::array<int, 3> out{0, 0, 0};
  for (std::size_t i = 0; i < count; ++i) {
    if (v[i] < 0.0 || v[i] > 1e6 || !isWhole(v[i])) refuseOption("--explain", fmt::format("'{}' is no texel X,Y or X,Y,MAP", text));
    out[i] = int(v[i]);
  }
  return out;
}

std::uint64_t memoryOf(const std::string& text) {
  const auto bytes = bytesOf(text);
  if (!bytes) refuseOption("--memory", fmt::format("'{}' is not a size such as 512M or 2G", text));
  return *bytes;
}

std::vector<double> ladderOf(const std::string& text, bool shares, bool counts) {
  std::vector<double> out;
  if (text.empty()) return out;
  forParts(text, [&](std::string_view rung) {
    if (shares && rung.ends_with('%')) rung.remove_suffix(1);
    const auto value = number(rung);
    if (!value || !(*value > 0.0) || (shares && *value > 100.0) || (counts && (!isWhole(*value) || *value > 16384.0)))
      refuseOption("--ladder", fmt::format("'{}' is no rung", rung));
    out.push_back(shares ? *value / 100.0 : *value);
  });
  for (std::size_t k = 1; k < out.size(); ++k)
    if (counts ? out[k] <= out[k - 1] : out[k] >= out[k - 1]) refuseOption("--ladder", "from coarse to fine, no rung twice");
  return out;
}

}  // namespace lmc
