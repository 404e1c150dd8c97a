#include "lmc/verify.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "libscene/files.h"
#include "libscene/parallel.h"
#include "lmc/bake.h"
#include "lmc/tangent_loop.h"
#include "lmc/verify_case.h"
#include "lmc/verify_tangent.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;

constexpr double kStandardErrors = 4.0;        // a right value lies outside 6 times in 100,000
constexpr double kShareOfTolerance = 1.0 / 3;  // a standard error above it could not tell right from wrong

constexpr const char* kWay[] = {"double", "float", "solver"};

struct Judged {
  std::string name, unit;
  double exact = 0.0, got = 0.0, error = 0.0, tolerance = 0.0;
  std::optional<double> standardError;
  const char* kind = "";
  bool pass = false;
};

struct Result {
  std::string id, kind, result, why, note;
  std::vector<Judged> values;
  std::vector<WrongCorner> corners;  ///< of tangent vectors
};

double toleranceOf(const Parameters& tol, const char* key) { return tol.numberOr(key, 0.0); }

/// Nothing when the value's tolerances have no word on values got this way.
std::optional<Judged> judge(const Parameters& value, const Got& got) {
  const Parameters tol = value["tol"];
  Judged j;
  j.name = value["name"].text();
  const long double exact = value["value"].extended();
  j.exact = double(exact);
  j.got = got.value;
  j.error = double(std::abs((long double)(got.value) - exact));
  j.kind = kWay[int(got.way)];
  const double size = std::abs(j.exact);
  bool enough = true;
  if (got.way == Way::Sampled) {
    if (!tol.has("solver_rel")) return std::nullopt;
    const double allowed = toleranceOf(tol, "solver_rel") * size;
    enough = got.standardError <= kShareOfTolerance * allowed;
    j.standardError = got.standardError;
    j.tolerance = std::min(allowed, kStandardErrors * got.standardError + got.rounding);
  } else {
    const char* rel = got.way == Way::Double ? "double_rel" : "float_rel";
    const char* abs = got.way == Way::Double ? "double_abs" : "float_abs";
    if (!tol.has(rel) && !tol.has(abs)) return std::nullopt;
    j.tolerance = toleranceOf(tol, rel) * size + toleranceOf(tol, abs);
  }
  j.tolerance = std::max(j.tolerance, value.numberOr("uncertainty", 0.0));
  j.pass = enough && std::isfinite(got.value) && j.error <= j.tolerance;
  return j;
}

const std::vector<CaseKind>& kinds() {
  static const std::vector<CaseKind> all = [] {
    std::vector<CaseKind> table;
    for (const auto& family : {formFactorKinds(), lightKinds(), skyKinds(), enclosureKinds(), aoKinds()})
      table.insert(table.end(), family.begin(), family.end());
    return table;
  }();
  return all;
}

void runValues(Result& r, const Parameters& values, const Evaluate& evaluate) {
  std::string unknown, unjudged;
  const auto add = [](std::string& list, const std::string& name) { list += (list.empty() ? "'" : ", '") + name + "'"; };
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Parameters value = values.at(i), tol = value["tol"];
    const std::string name = value["name"].text();
    const double most = kShareOfTolerance * toleranceOf(tol, "solver_rel") * std::abs(value["value"].number());
    // A little less than what is allowed: the standard error is an estimate, too.
    const std::optional<Got> got = evaluate({name, tol.has("solver_rel") ? 0.9 * most : 0.0});
    if (!got) {
      add(unknown, name);
      continue;
    }
    if (std::optional<Judged> j = judge(value, *got)) {
      if (value.has("unit")) j->unit = value["unit"].text();
      r.values.push_back(*j);
    } else {
      add(unjudged, name);
    }
  }
  const bool failed = std::ranges::any_of(r.values, [](const Judged& j) { return !j.pass; });
  r.result = failed ? "fail" : "pass";
  if (!unknown.empty()) r.why = fmt::format("nothing of kind {} is called {}", r.kind, unknown);
  if (!unjudged.empty()) r.why += fmt::format("{}no tolerance for the way in which lmc gets {}", r.why.empty() ? "" : "; ", unjudged);
  // A case of which a part was not looked at has not passed.
  if (!failed && !r.why.empty()) r.result = "left_out";
}

Result runCase(const Parameters& c, const VerifyContext& context) {
  Result r;
  r.id = c["id"].text();
  r.kind = c["kind"].text();
  r.result = "left_out";
  const auto found = std::ranges::find(kinds(), r.kind, &CaseKind::name);
  if (found == kinds().end()) {
    r.why = fmt::format("kind {} is not known", r.kind);
    return r;
  }
  const Parameters values = c["values"];
  try {
    if (values.size() > 0) {
      runValues(r, values, found->make(c["geometry"], context));
      return r;
    }
    r.why = "the case states no value";
    if (r.kind != "attenuation/guard") return r;
    // What has no right answer must at least have a finite one.
    const std::optional<Got> got = found->make(c["geometry"], context)({"attenuation", 0.0});
    if (!std::isfinite(got->value)) r.result = "fail";
    r.note = fmt::format("gave {}: a zero denominator counts as no light", got->value);
  } catch (const LeftOut& out) {
    r.why = out.why;
  }
  return r;
}

Json number(double x) { return std::isfinite(x) ? Json(x) : Json(fmt::format("{}", x)); }

Json asJson(const Result& r) {
  Json out{{"id", r.id}, {"kind", r.kind}, {"result", r.result}};
  if (!r.why.empty()) out["why"] = r.why;
  if (!r.note.empty()) out["note"] = r.note;
  out["values"] = Json::array();
  for (const Judged& j : r.values) {
    Json v{{"name", j.name},
           {"exact", number(j.exact)},
           {"got", number(j.got)},
           {"error", number(j.error)},
           {"tolerance", number(j.tolerance)},
           {"kind", j.kind},
           {"pass", j.pass}};
    if (j.standardError) v["standard_error"] = number(*j.standardError);
    out["values"].push_back(v);
  }
  for (const WrongCorner& c : r.corners) out["corners"].push_back({{"corner", c.corner}, {"what", c.what}});
  return out;
}

void print(const Result& r) {
  for (const Judged& j : r.values)
    fmt::print("{:<4} {:<22} {:<26} exact {:<22.15g} got {:<22.15g} error {:<8.2g} of {:<8.2g} {}\n", j.pass ? "pass" : "FAIL", r.id,
               j.name, j.exact, j.got, j.error, j.tolerance, j.kind);
  if (!r.why.empty())
    fmt::print("{:<4} {:<22} {}{}{}\n", r.result == "fail" ? "FAIL" : "out", r.id, r.why, r.note.empty() ? "" : "; ", r.note);
  else if (r.values.empty())
    fmt::print("{:<4} {:<22} {:<14} {}\n", r.result == "fail" ? "FAIL" : r.result, r.id, r.kind, r.note);
  for (const WrongCorner& c : r.corners) fmt::print("     {:<22} corner {}\n", r.id, c.what);
  std::fflush(stdout);
}

Result resultOf(const std::string& id, const char* kind, const TangentVerdict& verdict) {
  Result r;
  r.id = id;
  r.kind = kind;
  r.result = verdict.wrong > 0 ? "fail" : "pass";
  r.note = verdict.summary;
  r.corners = verdict.first;
  return r;
}

/// A file of tangent vectors is two cases: exact mode against the reference, and safe mode against its promises.
std::vector<Result> runTangents(const std::string& id, const TangentVectors& vectors, const Run& run) {
  const tangent::ReferenceTangents exact = referenceTangentsOf(vectors.surface(), run);
  const tangent::Tangents safe = tangentsOf(vectors.surface(), run);
  return {resultOf(id, "tangent/exact", judgeExact(vectors, exact)), resultOf(id, "tangent/safe", judgeSafe(vectors, exact, safe))};
}

bool isTangentFile(const std::filesystem::path& file) { return file.extension() == ".tspace"; }

nlohmann::json readCases(const std::filesystem::path& file) {
  const std::vector<std::uint8_t> bytes = readFile(file);
  nlohmann::json document;
  try {
    document = nlohmann::json::parse(bytes.begin(), bytes.end());
  } catch (const nlohmann::json::exception& e) {
    throw Error(Exit::Broken, file, "", fmt::format("is no JSON: {}", e.what()), "LMC_CASE");
  }
  const Parameters root(document, file.string(), "");
  if (root["schema"].text() != "lmc-analytic/1") root["schema"].broken("is not 'lmc-analytic/1'");
  return document;
}

}  // namespace

Exit verify(const VerifyOptions& options) {
  const VerifyContext context{options.threads, options.seed};
  // All files are read before the first case runs: a name mistyped at the end is not found after minutes.
  std::vector<nlohmann::json> documents;
  std::vector<TangentVectors> vectors;
  for (const std::filesystem::path& file : options.files) {
    vectors.push_back(isTangentFile(file) ? readTangentVectors(file) : TangentVectors{});
    documents.push_back(isTangentFile(file) ? nlohmann::json{{"cases", nlohmann::json::array()}} : readCases(file));
  }
  // A whole id means that case alone, though other ids may begin with it.
  bool exact = false;
  for (std::size_t f = 0; f < documents.size(); ++f) {
    const Parameters list = Parameters(documents[f], options.files[f].string(), "")["cases"];
    for (std::size_t i = 0; i < list.size(); ++i) exact |= list.at(i)["id"].text() == options.only;
  }
  const auto wanted = [&](const std::string& id) { return exact ? id == options.only : id.starts_with(options.only); };
  Json cases = Json::array();
  std::size_t passed = 0, failed = 0, leftOut = 0;
  const auto tell = [&](const Result& r) {
    ++(r.result == "pass" ? passed : r.result == "fail" ? failed : leftOut);
    if (options.json)
      cases.push_back(asJson(r));
    else
      print(r);
  };
  Run run = stoppableRun(options.threads);
  run.seed = options.seed;
  for (std::size_t f = 0; f < documents.size(); ++f) {
    const std::string stem = options.files[f].stem().string();
    if (isTangentFile(options.files[f]) && wanted(stem)) {
      std::vector<Result> results;
      withThreads(run, [&] { results = runTangents(stem, vectors[f], run); });
      for (const Result& r : results) tell(r);
    }
    const Parameters list = Parameters(documents[f], options.files[f].string(), "")["cases"];
    for (std::size_t i = 0; i < list.size(); ++i) {
      const Parameters c = list.at(i);
      if (!wanted(c["id"].text())) continue;
      Result r;
      withThreads(run, [&] { r = runCase(c, context); });
      tell(r);
    }
  }
  if (options.json)
    fmt::print("{}\n", Json{{"cases", cases}}.dump(1));
  else
    fmt::print("{} passed, {} failed, {} left out\n", passed, failed, leftOut);
  return failed > 0 ? Exit::Numerical : Exit::Done;
}

}  // namespace lmc
