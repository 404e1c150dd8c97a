#include "lmc/fit_attenuation.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

#include "libradiosity/lights.h"
#include "libscene/files.h"

namespace lmc {

namespace {

constexpr int kFitPlaces = 512;         // evenly between near and range
constexpr double kNearShare = 0.01;  // of the range: where a fall-off without an upper end begins to count

struct Kind {
  const char* name;
  bool endless;  // at distance 0
  double (*value)(double distance_m, double range_m);
};
constexpr Kind kKinds[] = {
    {"inverse-square", true, [](double d, double) { return 1.0 / (d * d); }},
    {"inverse-square-window", true, [](double d, double r) { return rangeWindow(d, r) / (d * d); }},
    {"inverse", true, [](double d, double) { return 1.0 / d; }},
    {"smooth", false, [](double d, double r) { return std::pow(1.0 - std::pow(d / r, 2.0), 2.0); }},
    {"smoothstep", false, [](double d, double r) { return 1.0 - d / r * (d / r) * (3.0 - 2.0 * d / r); }},
    {"linear", false, [](double d, double r) { return 1.0 - d / r; }},
    {"suggested", false,
     [](double d, double r) {
       return attenuation({1.0, 2.0 / r, 1.0 / (r * r), r, 2.0}, d);
     }},
};

/// Lines of "distance value" or "distance,value"; empty ones and those that begin with # are left out.
std::vector<FallOffPlace> placesOf(const std::filesystem::path& file) {
  const std::vector<std::uint8_t> bytes = readFile(file, 1 << 24);
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  std::vector<FallOffPlace> out;
  int line = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    std::string row(text.substr(at, end - at));
    at = end + 1;
    ++line;
    std::ranges::replace_if(
        row, [](char c) { return c == ',' || c == ';' || c == '\t' || c == '\r'; }, ' ');
    const char *p = row.data(), *last = row.data() + row.size();
    const auto skip = [&] {
      while (p != last && *p == ' ') ++p;
    };
    skip();
    if (p == last || *p == '#') continue;
    double value[2];
    bool good = true;
    for (double& v : value) {
      const auto [next, error] = std::from_chars(p, last, v);
      good = good && error == std::errc() && std::isfinite(v);
      p = next;
      skip();
    }
    if (!good || p != last || value[0] < 0.0 || value[1] < 0.0)
      throw Error(Exit::Broken, file, fmt::format("line {}", line), "is not a distance and a value, neither of them negative");
    out.push_back({value[0], value[1]});
  }
  const auto bright = [](const FallOffPlace& p) { return p.value > 0.0; };
  if (std::ranges::count_if(out, bright) < 4) throw Error(Exit::Broken, file, "", "four places with a value above 0 are needed at least");
  std::ranges::stable_sort(out, {}, &FallOffPlace::distance_m);
  if (!(out[0].value > 0.0)) throw Error(Exit::Broken, file, "", "the nearest place has no light");
  return out;
}

}  // namespace

std::vector<FallOffPlace> fallOffPlaces(const FitAttenuationOptions& o) {
  const auto kind = std::ranges::find(kKinds, o.fallOff, &Kind::name);
  if (kind == std::end(kKinds)) {
    if (std::filesystem::exists(o.fallOff)) return placesOf(o.fallOff);
    std::vector<std::string> names;
    for (const Kind& k : kKinds) names.emplace_back(k.name);
    throw Error(Exit::Usage, "lmc", "", fmt::format("--falloff: '{}' is neither {} nor a file", o.fallOff, fmt::join(names, ", ")));
  }
  const double near = o.near_m > 0.0 ? o.near_m : kind->endless ? kNearShare * o.range_m : 0.0;
  if (near >= o.range_m) throw Error(Exit::Usage, "lmc", "", "--near must be below --range");
  std::vector<FallOffPlace> out;
  for (int i = 0; i < kFitPlaces; ++i) {
    const double d = near + (o.range_m - near) * i / (kFitPlaces - 1);
    out.push_back({d, kind->value(d, o.range_m)});
  }
  return out;
}

Exit fitAttenuation(const FitAttenuationOptions& o) {
  const std::vector<FallOffPlace> places = fallOffPlaces(o);
  const AttenuationFit fit = fitAttenuation(places, o.range_m);
  const ClassicAttenuation& a = fit.attenuation;
  if (o.json) {
    const nlohmann::ordered_json attenuation = {
        {"constant", a.constant}, {"linear", a.linear}, {"quadratic", a.quadratic}, {"range", a.range}, {"power", a.power}};
    fmt::print(
        "{}\n",
        nlohmann::ordered_json{
            {"falloff", o.fallOff},
            {"attenuation", attenuation},
            {"error",
             {{"rms", fit.rms}, {"largest", fit.largest}, {"largest_at_m", fit.largestAt_m}, {"largest_difference", fit.largestValue}}},
            {"from_m", places.front().distance_m},
            {"to_m", places.back().distance_m},
            {"places", places.size()}}
            .dump(2));
    return Exit::Done;
  }
  fmt::print("a(d) = 1/(c + l d + q d^2) * saturate(1 - (d/range)^power), d in metres\n");
  fmt::print("constant  {:.6g}\nlinear    {:.6g}\nquadratic {:.6g}\nrange     {:.6g}\npower     {:.6g}\n", a.constant, a.linear,
             a.quadratic, a.range, a.power);
  fmt::print("error     {:.3g} % RMS of the value wished, at most {:.3g} % at {:.3g} m ({} places from {:.3g} to {:.3g} m)\n",
             100.0 * fit.rms, 100.0 * fit.largest, fit.largestAt_m, places.size(), places.front().distance_m, places.back().distance_m);
  fmt::print(
      "\"extras\": {{\"lmc\": {{\"model\": \"classic\", \"attenuation\": {{\"constant\": {:.6g}, \"linear\": {:.6g}, \"quadratic\": "
      "{:.6g}, "
      "\"range\": {:.6g}, \"power\": {:.6g}}}}}}}\n",
      a.constant, a.linear, a.quadratic, a.range, a.power);
  return Exit::Done;
}

}  // namespace lmc
