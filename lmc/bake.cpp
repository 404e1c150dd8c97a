#include "lmc/bake.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>

#include "libscene/parallel.h"
#include "lmc/explain.h"
#include "lmc/outputs.h"
#include "lmc/plan_report.h"
#include "lmc/report.h"

namespace lmc {

namespace {

std::atomic<int> stopSignal{0};

/// One stage: timed, counted, told.
void perform(const StageRow& stage, Bake& b, Progress& progress, Spoken& spoken, double before) {
  progress.begin(stage.name, before, stage.share);
  const auto start = std::chrono::steady_clock::now();
  const double cpu = cpuSeconds();
  const std::uint64_t rays = b.tracer ? b.tracer->rays() : 0;
  b.summary.clear();
  stage.work(b);
  b.run.progress(1.0);
  spoken.stages.push_back({stage.name, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), cpuSeconds() - cpu,
                           (b.tracer ? b.tracer->rays() : 0) - rays, b.summary});
  progress.end(spoken.stages.back());
}

Run makeRun(const BakeOptions& options, Progress& progress, Spoken& spoken) {
  Run run;
  run.threads = options.threads;
  run.seed = options.seed;
  run.onProgress = [&progress](double share) {
    progress.update(share);
    return stopSignal == 0;
  };
  run.onMessage = [&](const Message& m) {
    progress.say(line(m.level == Message::Level::Warning ? "warning" : "note", m.file, m.where, m.text, m.code));
    spoken.messages.push_back(m);
  };
  return run;
}

std::string figure(double share) { return fmt::format("{:.2f} %", 100.0 * share); }

}  // namespace

Run stoppableRun(int threads) {
  Run run;
  run.threads = threads;
  run.onProgress = [](double) { return stopSignal == 0; };
  return run;
}

void askToStop(int signal) { stopSignal = signal; }
int askedToStop() { return stopSignal; }

Exit bake(const BakeOptions& options) {
  Progress progress(options.progress);
  Spoken spoken;
  Bake b(options, makeRun(options, progress, spoken));
  Exit result = Exit::Done;
  withThreads(b.run, [&] {
    double before = 0.0;
    std::unique_ptr<OutputSet> outputs, dependencies;
    for (const StageRow& stage : kStages) {
      perform(stage, b, progress, spoken, before);
      before += stage.share;
      // A level that cannot be read makes no folder; a folder that cannot be written to is found before the work.
      if (outputs) continue;
      refuseToOverwriteInputs(b);
      outputs = std::make_unique<OutputSet>(options.out);
      if (!options.depfile.empty())
        dependencies = std::make_unique<OutputSet>(options.depfile.parent_path().empty() ? "." : options.depfile.parent_path());
    }
    const bool met = b.ledger.bound95 <= options.goal && b.ledger.worstObject <= 3.0 * options.goal;
    if (!met && options.goalIsExplicit) {
      result = Exit::GoalMissed;
      b.run.warn(
          {{},
           options.level.string(),
           "",
           fmt::format("the goal of {} was missed: error {}, at most {}; worst object '{}' at most {}", figure(options.goal),
                       figure(b.ledger.estimate), figure(b.ledger.bound95),
                       b.ledger.worstObjectId == kNone ? "" : b.scene.objects[b.ledger.worstObjectId].path, figure(b.ledger.worstObject)),
           "LMC_GOAL"});
    }
    if (b.openness.asked > 0 && b.openness.rmsError > options.ao.how.error && options.ao.errorIsExplicit) {
      result = Exit::GoalMissed;
      b.run.warn({{},
                  options.level.string(),
                  "",
                  fmt::format("the goal of {} for ambient occlusion was missed: error {:.4f}", options.ao.how.error, b.openness.rmsError),
                  "LMC_GOAL"});
    }
    const nlohmann::ordered_json report = reportOf(b, spoken, met);
    writeOutputs(*outputs, b, report);
    if (dependencies) dependencies->open(options.depfile.filename()).write(depfileText(b));
    b.run.progress(1.0);  // the last moment to stop
    if (dependencies) dependencies->commit();
    outputs->commit();
    if (options.json)
      fmt::print("{}\n", report.dump(2));
    else if (options.explain)
      fmt::print("{}", explainText(b.explained));
    if (options.progress != ProgressKind::None && options.progress != ProgressKind::Json)
      progress.say(fmt::format("baked {} in {:.1f} s ({:.1f} CPU s, {:.0f} MB): error {}, at most {} (goal {})", options.out.string(),
                               double(report["seconds"]), double(report["cpu_seconds"]), double(peakBytes()) / 1e6,
                               figure(b.ledger.estimate), figure(b.ledger.bound95), figure(options.goal)));
  });
  return result;
}

Exit showPlan(const PlanOptions& options) {
  Progress progress(ProgressKind::None);
  Spoken spoken;
  Bake b(options.bake, makeRun(options.bake, progress, spoken));
  withThreads(b.run, [&] {
    for (const StageRow& stage : kStages) {
      perform(stage, b, progress, spoken, 0.0);
      if (stage.work == pilot) break;
    }
  });
  if (options.bake.json)
    fmt::print(
        "{}\n",
        nlohmann::ordered_json{{"plan", planOf(b, spoken.stages)}, {"forecast", forecastOf(b, spoken.stages)}, {"facts", factsOf(b)}}.dump(
            2));
  else
    fmt::print("{}", planText(b, spoken.stages));
  return Exit::Done;
}

}  // namespace lmc
