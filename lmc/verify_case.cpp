#include "lmc/verify_case.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "libscene/constants.h"
#include "libscene/error.h"

namespace lmc {

bool Parameters::has(std::string_view key) const { return value_->is_object() && value_->contains(std::string(key)); }

Parameters Parameters::operator[](std::string_view key) const {
  if (!value_->is_object()) broken("is no object");
  const auto found = value_->find(std::string(key));
  if (found == value_->end()) broken(fmt::format("lacks '{}'", key));
  std::string escaped;
  for (const char c : key) escaped += c == '~' ? "~0" : c == '/' ? "~1" : std::string(1, c);
  return {*found, file_, pointer_ + "/" + escaped};
}

Parameters Parameters::at(std::size_t index) const {
  if (index >= size()) broken(fmt::format("has no entry {}", index));
  return {(*value_)[index], file_, fmt::format("{}/{}", pointer_, index)};
}

std::size_t Parameters::size() const {
  if (!value_->is_array()) broken("is no list");
  return value_->size();
}

long double Parameters::extended() const {
  long double x = 0.0L;
  if (value_->is_number()) {
    x = (long double)(value_->get<double>());
  } else if (value_->is_string()) {
    const std::string& s = value_->get_ref<const std::string&>();
    const auto [end, error] = std::from_chars(s.data(), s.data() + s.size(), x);
    if (error != std::errc() || end != s.data() + s.size()) broken(fmt::format("'{}' is no decimal number", s));
  } else {
    broken("is no decimal number");
  }
  if (!std::isfinite(x) || !std::isfinite(double(x))) broken("is not finite");
  return x;
}

std::string Parameters::text() const {
  if (!value_->is_string()) broken("is no text");
  return value_->get<std::string>();
}

glm::dvec3 Parameters::vec3() const {
  if (size() != 3) broken("is not three numbers");
  return {at(0).number(), at(1).number(), at(2).number()};
}

std::vector<glm::dvec3> Parameters::polygon() const {
  std::vector<glm::dvec3> p;
  for (std::size_t i = 0; i < size(); ++i) p.push_back(at(i).vec3());
  if (p.size() < 3) broken("has fewer than three corners");
  if (!(glm::length(polygonNormal(p)) > 0.0)) broken("has no area");
  return p;
}

std::vector<double> Parameters::numbers() const {
  std::vector<double> out;
  for (std::size_t i = 0; i < size(); ++i) out.push_back(at(i).number());
  return out;
}

std::vector<long double> Parameters::extendeds() const {
  std::vector<long double> out;
  for (std::size_t i = 0; i < size(); ++i) out.push_back(at(i).extended());
  return out;
}

double Parameters::angle_rad(const std::string& key) const {
  if (has(key + "_deg")) return number(key + "_deg") * kPi / 180.0;
  return has(key + "_rad") ? number(key + "_rad") : number(key);
}

void Parameters::broken(std::string_view what) const { throw Error(Exit::Broken, file_, pointer_, what, "LMC_CASE"); }

double cosDegrees(double degrees) { return sinDegrees(90.0 - std::abs(degrees)); }

double sinDegrees(double degrees) {
  double x = std::remainder(degrees, 360.0);  // exact
  if (x > 90.0) x = 180.0 - x;
  if (x < -90.0) x = -180.0 - x;
  return std::abs(x) > 45.0 ? std::copysign(std::cos((90.0 - std::abs(x)) * kPi / 180.0), x) : std::sin(x * kPi / 180.0);
}

std::optional<std::size_t> indexOf(std::string_view name, std::string_view stem, std::size_t count) {
  if (!name.starts_with(stem) || name.size() < stem.size() + 3 || name[stem.size()] != '[' || name.back() != ']') return std::nullopt;
  const std::string_view digits = name.substr(stem.size() + 1, name.size() - stem.size() - 2);
  std::size_t index = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), index);
  if (error != std::errc() || end != digits.data() + digits.size() || index >= count) return std::nullopt;
  return index;
}

double fewSamples(int samples) { return 1.0 + 10.0 / std::pow(std::max(1, samples - 1), 1.15); }

Got sampleUntil(double standardError, int least, int most, const std::function<double(int)>& sample) {
  double mean = 0.0, squares = 0.0, error = 0.0;  // Welford's sums: equal samples have no error at all
  for (int n = 1; n <= most; ++n) {
    const double x = sample(n - 1), by = x - mean;
    mean += by / n;
    squares += by * (x - mean);
    error = n > 1 ? fewSamples(n) * std::sqrt(squares / (double(n) * (n - 1))) : 0.0;
    if (n >= least && error <= standardError) break;
  }
  return {mean, Way::Sampled, error, 0.0};
}

}  // namespace lmc
