#include "lmc/study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "libradiosity/patch_mesh.h"
#include "libscene/files.h"
#include "lmc/bake.h"
#include "lmc/child.h"
#include "lmc/fits.h"
#include "lmc/memory.h"
#include "lmc/reference.h"
#include "lmc/study_page.h"
#include "lmc/study_plot.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr double kLargestReferenceError = 0.01, kReferenceShare = 1.0 / 3.0;  // of the finest rung
struct Preset {
  double error;
  const char* name;
};
constexpr Preset kPresetMarks[] = {{0.08, "draft"}, {0.02, "level"}, {0.01, "final"}};

/// What a knob is called, its usual ladder, and how a rung sets it.
struct Knob {
  const char* name;
  std::vector<double> ladder;
  std::function<void(BakeOptions&, double)> set;
  std::function<std::string(double)> label;
};

Knob knobOf(Vary vary, double patchSize_m) {
  const auto percent = [](double v) { return fmt::format("{:g} %", 100.0 * v); };
  switch (vary) {
    case Vary::Error:
      break;
    case Vary::Ao:
      return {"error of openness",
              {0.04, 0.02, 0.01, 0.005},
              [](BakeOptions& o, double v) {
                o.ao.how.error = v;
                o.effects = "ao";
              },
              percent};
    case Vary::Patches:
      return {"patch size",
              {4.0 * patchSize_m, 2.0 * patchSize_m, patchSize_m, 0.5 * patchSize_m},
              [](BakeOptions& o, double v) { o.patchSize_m = v; },
              [](double v) { return fmt::format("{:.3g} m", v); }};
    case Vary::Rays:
      return {"hemisphere rays a half",
              {16, 64, 256, 1024},
              [](BakeOptions& o, double v) { o.gatherRays = std::uint32_t(v); },
              [](double v) { return fmt::format("{:g} rays", v); }};
    case Vary::Passes:
      return {"passes",
              {1, 2, 3, 4, 6, 8},
              [](BakeOptions& o, double v) { o.passes = int(v); },
              [](double v) { return fmt::format("{:g} passes", v); }};
  }
  return {"error asked for", {0.08, 0.04, 0.02, 0.01, 0.005}, [](BakeOptions& o, double v) { o.goal = v; }, percent};
}

std::optional<Json> readJson(const fs::path& file) {
  std::error_code missing;
  if (!fs::exists(file, missing)) return std::nullopt;
  const std::vector<std::uint8_t> bytes = readFile(file);
  Json json = Json::parse(bytes.begin(), bytes.end(), nullptr, false);
  if (json.is_discarded()) return std::nullopt;
  return json;
}

std::string hashOf(const std::string& text) { return contentHash({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}); }

/// Everything that a bake depends on but the level's own bytes.
std::string textOf(const BakeOptions& o) {
  return fmt::format("{} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {}", LMC_VERSION, o.goal, o.effects,
                     o.passes, o.bounceTail, int(o.solver), o.patchSize_m, o.maxPatches, o.interpolate, o.gatherRays, int(o.audit),
                     o.maxLinks, o.partition.automatic, fmt::join(o.partition.on, ","), int(o.uv.mode), o.uv.mapSize, o.uv.texelsPerMetre,
                     o.uv.padding, o.uv.maxMaps, o.ao.how.error, o.ao.how.distance_m, int(o.ao.how.fallOff), o.ao.bentInTangentSpace,
                     o.sky ? fmt::format("{},{},{}", o.sky->r, o.sky->g, o.sky->b) : "scene", o.seed, o.gatherRounds);
}

/// What the level's files hold, and the size of its patches at the goal: found by a process of its own, for reading takes memory.
struct Level {
  std::string hash;
  double patchSize_m = 0.0;
};
Level levelOf(const StudyOptions& o) {
  const fs::path file = o.bake.out / "level.json";
  const Exit exit = inChild([&] {
    const Scene scene = loadLevel(o.bake.level, o.bake.limits, stoppableRun(o.bake.threads));
    std::string hashes;
    for (const fs::path& input : scene.inputs) hashes += contentHash(readFile(input));
    const double size = scene.triangles.empty() ? 1.0 : patchSizeFor_m(scene, squaresFor(o.bake.goal));
    writeFileWhole(file, Json{{"hash", hashOf(hashes)}, {"patch_size_m", size}}.dump(2) + "\n");
    return Exit::Done;
  });
  if (exit != Exit::Done) throw Error(exit, o.bake.level, "", "could not be studied");
  const auto json = readJson(file);
  if (!json) throw Error(Exit::Io, file, "", "was not written");
  return {(*json)["hash"], (*json)["patch_size_m"]};
}

/// A finished rung: its files are those that its sidecar vouches for.
bool isWhole(const fs::path& folder) {
  const auto sidecar = readJson(folder / "level.lmc.json");
  if (!sidecar || !sidecar->contains("files")) return false;
  for (const Json& f : (*sidecar)["files"]) {
    const fs::path file = folder / std::string(f["name"]);
    std::error_code missing;
    if (!fs::exists(file, missing) || contentHash(readFile(file)) != std::string(f["xxh3"])) return false;
  }
  return true;
}

/// A row of the table, from a rung's report.
Json rowOf(const Json& report, const std::string& name, double value, bool openness) {
  Json row = {{"name", name}, {"value", value}};
  if (openness) {
    const Json& ao = report.value("ao", Json{{"goal", value}, {"error", 0.0}});
    const double e = ao["error"];
    row.update({{"promised", ao["goal"]}, {"estimate", e}, {"interval", {e, e}}, {"bound95", e}, {"goal_met", e <= double(ao["goal"])}});
  } else {
    const Json& e = report["error"];
    row.update({{"promised", e["goal"]},
                {"estimate", e["estimate"]},
                {"interval", e["interval"]},
                {"bound95", e["bound95"]},
                {"goal_met", e["goal_met"]},
                {"noise", e["noise"]},
                {"interpolation", e["interpolation"]},
                {"patches", e["patches"]},
                {"bounce_tail", e["bounce_tail"]}});
    if (e.contains("audit")) row["audit"] = e["audit"];
  }
  row.update({{"cpu_seconds", report["cpu_seconds"]},
              {"seconds", report["seconds"]},
              {"rays", report["rays"]["total"]},
              {"peak_memory_bytes", report["peak_memory_bytes"]},
              {"maps", report["maps"].size()},
              {"stages", Json::array()}});
  for (const Json& s : report["stages"])
    row["stages"].push_back({{"name", s["name"]}, {"cpu_seconds", s["cpu_seconds"]}, {"rays", s["rays"]}});
  return row;
}

class Study {
 public:
  explicit Study(const StudyOptions& o) : o_(o), openness_(o.vary == Vary::Ao) {}

  Exit run() {
    { const OutputSet writable(o_.bake.out); }
    level_ = levelOf(o_);
    knob_ = knobOf(o_.vary, level_.patchSize_m);
    if (!o_.ladder.empty()) knob_.ladder = o_.ladder;
    makeReferences();
    for (const double value : knob_.ladder) {
      climb(value);
      write();
    }
    if (o_.bake.json) fmt::print("{}\n", study_.dump(2));
    fmt::print(stderr, "study of {} in {}: study.html, study.svg, study.csv, study.json\n", o_.bake.level.filename().string(),
               o_.bake.out.string());
    return Exit::Done;
  }

 private:
  std::string keyOf(const BakeOptions& o, const std::string& more) const { return hashOf(level_.hash + textOf(o) + more); }

  void makeReferences() {
    if (!o_.makeReference) return;
    ReferenceWish wish;
    const double finest = o_.vary == Vary::Error || openness_ ? knob_.ladder.back() : o_.bake.goal;
    wish.error = o_.referenceError > 0.0 ? o_.referenceError : std::min(kLargestReferenceError, kReferenceShare * finest);
    wish.texels = o_.referenceTexels;
    wish.rays = o_.referenceRays;
    wish.openness = openness_;
    // The truth does not depend on a goal: a finer ladder goes on with the paths that are there.
    BakeOptions bake = o_.bake;
    bake.goal = BakeOptions().goal;
    wish.key = keyOf(bake, fmt::format(" reference {} {}", wish.texels, wish.openness));
    const auto there = readJson(o_.bake.out / "reference.json");
    if (there && there->value("key", "") == wish.key && double((*there)["noise"]) <= wish.error) {
      fmt::print(stderr, "reference: kept\n");
      return;
    }
    const Exit exit = inChild([&] { return makeReference(o_.bake, o_.bake.out, wish); });
    if (exit != Exit::Done) throw Error(exit, o_.bake.level, "", "no reference could be made");
  }

  std::vector<fs::path> referencesFor(std::size_t maps) const {
    if (o_.makeReference) {
      std::vector<fs::path> out;
      for (const std::string& name : namesOfMaps("reference", maps)) out.push_back(o_.bake.out / name);
      return out;
    }
    if (o_.reference.empty()) return {};
    if (maps == 1) return {o_.reference};
    // FILE.000.exr names its fellows.
    const std::string name = o_.reference.filename().string();
    const std::size_t at = name.rfind(".000.");
    if (at == std::string::npos)
      throw Error(Exit::Usage, o_.reference, "",
                  fmt::format("the level has {} maps: name the first of its references, NAME.000.exr", maps));
    std::vector<fs::path> out;
    for (std::size_t k = 0; k < maps; ++k)
      out.push_back(o_.reference.parent_path() / (name.substr(0, at) + fmt::format(".{:03}.", k) + name.substr(at + 5)));
    return out;
  }

  static std::vector<fs::path> mapsOf(const fs::path& folder, std::size_t maps, bool openness) {
    std::vector<fs::path> out;
    for (const std::string& name : namesOfMaps(openness ? "ao" : "lightmap", maps)) out.push_back(folder / name);
    return out;
  }

  /// Bakes a rung unless it is there.
  void climb(double value) {
    BakeOptions bake = o_.bake;
    bake.goalIsExplicit = bake.ao.errorIsExplicit = false;  // a goal that is missed is what a study is to show
    bake.json = false;
    bake.resume = false;  // the table says what a whole bake costs
    bake.depfile.clear();
    knob_.set(bake, value);
    const std::string label = knob_.label(value), key = keyOf(bake, "");
    std::string name = label;
    std::erase(name, '%');
    std::erase(name, ' ');
    bake.out = o_.bake.out / "rungs" / name;
    auto kept = readJson(bake.out / "rung.json");
    if (kept && kept->value("key", "") == key && isWhole(bake.out)) {
      fmt::print(stderr, "rung {}: kept\n", label);
    } else {
      fmt::print(stderr, "rung {}\n", label);
      const Exit exit = inChild([&] { return lmc::bake(bake); });
      if (exit != Exit::Done) throw Error(exit, o_.bake.level, "", fmt::format("the rung of {} could not be baked", label));
      const auto report = readJson(bake.out / "report.json");
      if (!report) throw Error(Exit::Io, bake.out / "report.json", "", "is not there");
      kept = Json{{"key", key}, {"row", rowOf(*report, label, value, openness_)}};
      writeFileWhole(bake.out / "rung.json", kept->dump(2) + "\n");
    }
    Json row = (*kept)["row"];
    const std::size_t maps = row["maps"];
    const std::vector<fs::path> references = referencesFor(maps), files = mapsOf(bake.out, maps, openness_);
    if (!references.empty()) {
      const TrueError e = trueError(files, references, openness_);
      row["true"] = {{"net", e.net},      {"rms", e.rms}, {"interval", {e.low, e.high}}, {"bias", e.bias}, {"reference_noise", e.noise},
                     {"texels", e.texels}};
    }
    rows_.push_back(std::move(row));
    pictures_.push_back({files, references, {}, openness_});
  }

  static double errorOf(const Json& row) { return row.contains("true") ? double(row["true"]["net"]) : double(row["estimate"]); }

  std::optional<PowerLaw> lawOf(const char* cost) const {
    std::vector<CurvePoint> points;
    for (const Json& r : rows_) points.push_back({errorOf(r), double(r[cost])});
    return fitPowerLaw(points);
  }

  Panel panelOf(const char* cost, const char* title, const char* name) const {
    Panel panel{title, rows_[0].contains("true") ? "true relative RMS error" : "estimated relative RMS error", name, true, false, {}, {}};
    PlotSeries estimate{"estimated", "#2b6cb0", 'o', {}, {}}, bound{"bound", "#b7791f", 's', {}, {}}, truth{"true", "#c53030", 'x', {}, {}};
    for (const Json& r : rows_) {
      const double y = r[cost];
      estimate.points.push_back({double(r["estimate"]), y, double(r["interval"][0]), double(r["interval"][1]), ""});
      bound.points.push_back({double(r["bound95"]), y, 0.0, 0.0, std::string(r["name"])});
      if (r.contains("true")) truth.points.push_back({double(r["true"]["net"]), y, 0.0, 0.0, ""});
    }
    (truth.points.empty() ? estimate : truth).law = lawOf(cost);
    panel.series = {estimate, bound};
    if (!truth.points.empty()) panel.series.push_back(truth);
    for (const Json& r : rows_)
      for (const Preset& p : kPresetMarks)
        if (o_.vary == Vary::Error && std::abs(double(r["value"]) - p.error) < 1e-9) panel.marks.push_back({p.error, p.name});
    return panel;
  }

  Panel knobPanel() const {
    Panel panel{fmt::format("error against {}", knob_.name), knob_.name, "relative RMS error", openness_, true, {}, {}};
    PlotSeries estimate{"estimated", "#2b6cb0", 'o', {}, {}}, truth{"true", "#c53030", 'x', {}, {}};
    std::vector<CurvePoint> points;
    for (const Json& r : rows_) {
      estimate.points.push_back({double(r["value"]), double(r["estimate"]), 0.0, 0.0, ""});
      if (r.contains("true")) truth.points.push_back({double(r["value"]), double(r["true"]["net"]), 0.0, 0.0, ""});
      points.push_back({double(r["value"]), errorOf(r)});
    }
    (truth.points.empty() ? estimate : truth).law = fitPowerLaw(points);
    panel.series = {estimate};
    if (!truth.points.empty()) panel.series.push_back(truth);
    return panel;
  }

  std::string csv() const {
    std::string out =
        "rung,value,promised,estimate,interval_low,interval_high,bound95,goal_met,true_error,true_low,true_high,reference_noise,cpu_"
        "seconds,"
        "seconds,rays,peak_memory_bytes";
    for (const Json& s : rows_[0]["stages"]) out += fmt::format(",cpu_{}", std::string(s["name"]));
    out += "\n";
    for (const Json& r : rows_) {
      out +=
          fmt::format("{},{},{},{},{},{},{},{},", std::string(r["name"]), double(r["value"]), double(r["promised"]), double(r["estimate"]),
                      double(r["interval"][0]), double(r["interval"][1]), double(r["bound95"]), int(bool(r["goal_met"])));
      if (r.contains("true"))
        out += fmt::format("{},{},{},{},", double(r["true"]["net"]), double(r["true"]["interval"][0]), double(r["true"]["interval"][1]),
                           double(r["true"]["reference_noise"]));
      else
        out += ",,,,";
      out += fmt::format("{},{},{},{}", double(r["cpu_seconds"]), double(r["seconds"]), std::uint64_t(r["rays"]),
                         std::uint64_t(r["peak_memory_bytes"]));
      for (const Json& s : r["stages"]) out += fmt::format(",{}", double(s["cpu_seconds"]));
      out += "\n";
    }
    return out;
  }

  std::string words() const {
    std::string out = fmt::format("lmc {}: {} rungs of {}, each a bake by itself.", LMC_VERSION, rows_.size(), knob_.name);
    if (const auto law = lawOf("rays"))
      out +=
          fmt::format(" Rays go with error^{:.2f} (half the error costs {:.1f} times the rays),", law->exponent, std::exp2(-law->exponent));
    if (const auto law = lawOf("cpu_seconds")) out += fmt::format(" CPU seconds with error^{:.2f}.", law->exponent);
    if (rows_[0].contains("true"))
      out += fmt::format(" True errors are those at the {} texels of the reference, whose noise ({:.2f} %) is taken out.",
                         std::uint64_t(rows_[0]["true"]["texels"]), 100.0 * double(rows_[0]["true"]["reference_noise"]));
    else
      out += " There is no reference: errors are those that the bakes state.";
    return out;
  }

  void write() {
    study_ = {{"schema", "lmc-study/1"}, {"version", LMC_VERSION}, {"level", o_.bake.level.filename().string()}, {"knob", knob_.name}};
    study_["text"] = words();
    for (const char* cost : {"cpu_seconds", "rays"})
      if (const auto law = lawOf(cost))
        study_["fit"][cost] = {
            {"factor", law->factor}, {"exponent", law->exponent}, {"exponent_error", law->exponentError}, {"rms_log", law->rms}};
    if (o_.makeReference) study_["reference"] = *readJson(o_.bake.out / "reference.json");
    if (!o_.reference.empty()) study_["reference"] = {{"file", o_.reference.filename().string()}};
    study_["rungs"] = rows_;
    std::vector<Panel> panels{panelOf("cpu_seconds", "CPU seconds against error", "CPU seconds"),
                              panelOf("rays", "rays against error", "rays")};
    if (o_.vary != Vary::Error) panels.push_back(knobPanel());
    const std::string svg = svgOf(panels);
    std::vector<PagePictures> pictures = pictures_;
    for (std::size_t k = 0; k + 1 < pictures.size(); ++k) pictures[k].finest = pictures.back().maps;
    OutputSet set(o_.bake.out);
    set.open("study.csv").write(csv());
    set.open("study.svg").write(svg);
    set.open("study.html").write(pageOf(study_, svg, pictures));
    set.open("study.json").write(study_.dump(2) + "\n");
    set.commit();
  }

  StudyOptions o_;
  bool openness_;
  Level level_;
  Knob knob_;
  std::vector<Json> rows_;
  std::vector<PagePictures> pictures_;
  Json study_;
};

}  // namespace

Exit study(const StudyOptions& o) { return Study(o).run(); }

}  // namespace lmc
