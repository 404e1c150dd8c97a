#pragma once
/// THE order of work: add a stage by adding a row. The report, the log and docs/stages.md follow this table.
#include <array>
#include <memory>
#include <nlohmann/json.hpp>

#include "libao/ao.h"
#include "libradiosity/audit.h"
#include "libradiosity/light_map.h"
#include "libradiosity/rims.h"
#include "libradiosity/seams.h"
#include "libradiosity/solve.h"
#include "libradiosity/solve_links.h"
#include "libradiosity/solve_stored.h"
#include "libscene/paging.h"
#include "libscene/unwrap.h"
#include "lmc/memory.h"
#include "lmc/plan.h"
#include "lmc/progress.h"

namespace lmc {

/// Products of the stages of one bake, in order; each stage reads what stands above and fills what is its own.
struct Bake {
  Bake(const BakeOptions& o, Run r) : options(o), run(std::move(r)) {}
  const BakeOptions& options;
  Run run;

  std::shared_ptr<Paging> paging;  ///< charts; null where memory holds all; shared by a draft and what follows it

  Scene scene;  // load
  Facts facts;  // plan, pilot
  /// Light is worked on in units of so many lumen (a power of two, 1 in ordinary levels), so that squares of it stay within floats; maps
  /// carry it in their scale.
  double lightUnit = 1.0;
  Plan plan;
  UvLayout uv;  // charts
  MemoryPlan memory;
  Charts charts;
  std::unique_ptr<TexelMap> texels;
  Seams seams;                                                  ///< of the level's surface; closed where the plan says so
  std::unique_ptr<Tracer> tracer;                               // trace
  std::array<std::uint64_t, kPurposeNames.size()> pilotRays{};  // pilot
  LightMap map;                                                 // direct, hemisphere
  std::unique_ptr<DirectLight> direct;
  PatchMesh patches;                 // patches
  double meanReflectance = 0.0;      ///< by area
  std::uint32_t clampedPatches = 0;  ///< whose albedo was above what can be solved
  double clampedAway = 0.0;          ///< share of the bounced light that the clamp may take
  PatchLight patchLight;
  std::array<Solution, 2> solutions;  // solve; dense and hierarchical fill both alike
  Solver solver = Solver::Shooting;   ///< the one that was taken
  LinkStats links;                    ///< hierarchical only
  double linkError = 0.0;
  Bounced coarseSolution;         ///< hierarchical: by the links of the round before
  std::uint64_t storedBytes = 0;  ///< stored only: hits, both streams
  double closureError = -1.0;     ///< of the form factors before scaling; -1 = none computed
  std::unique_ptr<Field> field;
  nlohmann::ordered_json explained;  ///< null unless asked for
  LightMapValues values;             // finish
  ErrorLedger ledger;
  TexelArray<float> stated;               ///< error of each texel [lx]
  AuditResult audit;                      // audit
  std::vector<float> scales;              ///< one a map: E = stored value * scale
  ao::Openness openness;                  ///< empty when the plan leaves it out
  std::uint64_t occlusionRaysBefore = 0;  ///< of an openness that a draft has made
  RimResult rimsFilled;                   // rims
  Padding padding;                        // seams
  SeamResult closed;                      ///< empty when the plan leaves seams as they are

  std::function<bool(double goal, std::uint64_t rays)> goOn;  ///< MapOptions

  std::string summary;  ///< of the stage that runs, for the log
  double tail() const { return std::max(solutions[0].tail, solutions[1].tail) + clampedAway; }
  double tailEstimate() const { return std::max(solutions[0].tailEstimate, solutions[1].tailEstimate); }
};

struct StageRow {
  const char* name;
  const char* product;
  double share;  ///< of the whole job's time, about: for the bar alone
  void (*work)(Bake&);
};

void load(Bake&);
void plan(Bake&);
void charts(Bake&);
void trace(Bake&);
void pilot(Bake&);
void directLight(Bake&);
void patches(Bake&);
void solve(Bake&);
void hemisphere(Bake&);
void finish(Bake&);
void checkByPaths(Bake&);
bool isChecked(const BakeOptions&);
/// What paths that check a map follow: all light that belongs to it, whether or not the plan left it out.
PathOptions pathsFor(const Bake&);
void occlude(Bake&);
void rims(Bake&);
void seams(Bake&);

inline constexpr std::array kStages{
    StageRow{"load", "scene", 0.02, load},
    StageRow{"plan", "effects", 0.0, plan},
    StageRow{"charts", "UV charts and texels", 0.02, charts},
    StageRow{"trace", "ray tracer", 0.02, trace},
    StageRow{"pilot", "bounds and forecast", 0.02, pilot},
    StageRow{"direct", "direct light", 0.15, directLight},
    StageRow{"patches", "patches", 0.02, patches},
    StageRow{"solve", "bounced light on patches", 0.12, solve},
    StageRow{"gather", "sky and bounced light", 0.47, hemisphere},
    StageRow{"finish", "values, error", 0.03, finish},
    StageRow{"audit", "error, checked by path tracing", 0.08, checkByPaths},
    StageRow{"occlude", "ambient occlusion", 0.05, occlude},
    StageRow{"rims", "light before solids", 0.0, rims},
    StageRow{"seams", "padding, seams closed", 0.02, seams},
};

}  // namespace lmc
