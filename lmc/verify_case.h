#pragma once
/// What the evaluators of reference cases share: parameters in, values with their standard error out.
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libradiosity/form_factor.h"

namespace lmc {

/// A part of a case file that knows its place, so that what is wrong with it can be named. Numbers are decimal strings (or plain numbers).
class Parameters {
 public:
  Parameters(const nlohmann::json& value, std::string file, std::string pointer)
      : value_(&value), file_(std::move(file)), pointer_(std::move(pointer)) {}

  bool has(std::string_view key) const;
  Parameters operator[](std::string_view key) const;  ///< throws Error Broken when it is missing
  Parameters at(std::size_t index) const;
  std::size_t size() const;  ///< of a list

  long double extended() const;  ///< every digit that fits; a share such as 1 - 0.999 keeps its own
  double number() const { return double(extended()); }
  std::string text() const;
  glm::dvec3 vec3() const;
  std::vector<glm::dvec3> polygon() const;
  std::vector<double> numbers() const;
  std::vector<long double> extendeds() const;
  double number(std::string_view key) const { return (*this)[key].number(); }
  double numberOr(std::string_view key, double otherwise) const { return has(key) ? number(key) : otherwise; }
  /// An angle by the name it goes by: KEY_deg in degrees, KEY or KEY_rad in radians.
  double angle_rad(const std::string& key) const;

  [[noreturn]] void broken(std::string_view what) const;
  const nlohmann::json& json() const { return *value_; }

 private:
  const nlohmann::json* value_;
  std::string file_, pointer_;
};

/// How a value came about decides which tolerance judges it.
enum class Way {
  Double,   ///< closed form, quadrature or linear algebra in double or better
  Float,    ///< the same from a scene whose vertices are stored as float
  Sampled,  ///< rays, the whole pipeline, or a subdividing solver: comes with a standard error
};

struct Got {
  double value = 0.0;
  Way way = Way::Double;
  double standardError = 0.0;  ///< Sampled only
  double rounding = 0.0;       ///< Sampled only: what storage as float can make [same unit]
};

struct Wanted {
  std::string name;
  double standardError = 0.0;  ///< at most, when it is sampled; 0 = the case allows no sampling
};

struct VerifyContext {
  int threads = 0;
  std::uint64_t seed = 1;
};

/// Nothing for a name that it does not know.
using Evaluate = std::function<std::optional<Got>(const Wanted&)>;

/// Thrown where a case asks for what lmc does not have (a sky of another name): the case is left out, with this reason.
struct LeftOut {
  std::string why;
};

struct CaseKind {
  std::string_view name;
  Evaluate (*make)(const Parameters& geometry, const VerifyContext&);
};

std::vector<CaseKind> formFactorKinds();
std::vector<CaseKind> lightKinds();
std::vector<CaseKind> skyKinds();
std::vector<CaseKind> enclosureKinds();
std::vector<CaseKind> aoKinds();

/// Cosine and sine of degrees, exact at whole quarter turns and good to the last digit near them.
double cosDegrees(double degrees);
double sinDegrees(double degrees);

/// "B[3]" -> 3 for the stem "B"; nothing for another stem or no index below `count`.
std::optional<std::size_t> indexOf(std::string_view name, std::string_view stem, std::size_t count);

/// What the standard error of few samples must be multiplied by, so that 4 of it hold as often as 4 of a known one: Student's quantile
/// at 6e-5 over 4, fitted.
double fewSamples(int samples);

/// Mean and standard error of independent samples, drawn until the error is small enough or `most` are reached. sample(k) is the k-th.
Got sampleUntil(double standardError, int least, int most, const std::function<double(int)>& sample);

}  // namespace lmc
