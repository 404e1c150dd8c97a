#include "lmc/bake.h"

#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>

#include "libscene/parallel.h"
#include "lmc/explain.h"
#include "lmc/outputs.h"
#include "lmc/plan_report.h"
#include "lmc/report.h"
#include "lmc/resume.h"

namespace lmc {

namespace {

std::atomic<int> stopSignal{0};

std::string figure(double share) { return fmt::format("{:.2f} %", 100.0 * share); }

constexpr std::size_t kManyTriangles = 100'000;  // from there on what a stage takes for itself goes back to the system after it

/// One bake under way.
struct Work {
  Work(const BakeOptions& options, Progress& p) : progress(p), b(options, runOf(options)) {}

  /// One stage: timed, counted, told.
  void perform(const StageRow& stage) {
    progress.begin(stage.name, before, stage.share);
    const auto start = std::chrono::steady_clock::now();
    const double cpu = cpuSeconds();
    raysBefore = b.tracer ? b.tracer->rays() : 0;
    b.summary.clear();
    stage.work(b);
    if (b.paging || b.scene.triangles.size() > kManyTriangles) ::malloc_trim(0);
    b.run.progress(1.0);
    spoken.stages.push_back({stage.name, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(),
                             cpuSeconds() - cpu, (b.tracer ? b.tracer->rays() : 0) - raysBefore, b.summary});
    progress.end(spoken.stages.back());
    before += stage.share;
  }

  double secondsOf(std::string_view stage) const {
    double sum = 0.0;
    for (const StageTime& t : spoken.stages) sum += t.name == stage ? t.seconds : 0.0;
    return sum;
  }

  Progress& progress;
  Spoken spoken;
  Bake b;
  double before = 0.0;           ///< share of the job that is done
  std::uint64_t raysBefore = 0;  ///< of the stage that runs

 private:
  Run runOf(const BakeOptions& options) {
    Run run;
    run.threads = options.threads;
    run.seed = options.seed;
    run.onProgress = [this](double share) { progress.update(share); };
    run.stop = [] { return stopSignal != 0; };
    run.onMessage = [this](const Message& m) {
      progress.say(line(m.level == Message::Level::Warning ? "warning" : "note", m.file, m.where, m.text, m.code));
      spoken.messages.push_back(m);
    };
    return run;
  }
};

/// The folders that a bake writes to: a level that cannot be read makes none; one that cannot be written to is found before the work.
struct Targets {
  std::unique_ptr<OutputSet> outputs, dependencies;
  std::unique_ptr<Journal> journal;
  void open(Bake& b) {
    reportTrouble(journal.get(), b);
    if (outputs) return;
    refuseToOverwriteInputs(b);
    outputs = std::make_unique<OutputSet>(b.options.out);
    const auto& depfile = b.options.depfile;
    if (!depfile.empty()) dependencies = std::make_unique<OutputSet>(depfile.parent_path().empty() ? "." : depfile.parent_path());
  }
  /// Before the first stage that is worth keeping: what is refused until then leaves a journal as it is.
  void goOn(Bake& b) {
    journal = openJournal(b);
    b.run.journal = journal.get();
    reportTrouble(journal.get(), b);
  }
};

// A run with --time begins with a draft. Where there is time for a better bake, it gets a goal for all that is decided once (places of
// direct light, patches), so low that it takes about half of what is left; rounds of hemisphere rays fill the rest. Else the draft itself
// goes on in rounds.
constexpr double kDraft = 0.08, kFinest = 0.005;  // goals
constexpr double kFill = 0.97, kFull = 1.03;      // of the time: no round begins after the first, none that would end after the second
constexpr double kOver = 1.1;                     // of the time: what ends later could not be done in it
constexpr double kBaseShare = 0.5;
constexpr double kWorthwhile = 3.0;                                          // drafts that must fit into what is left
constexpr double kDirectPower = 0.7, kPatchPower = 1.2, kGatherPower = 1.8;  // seconds of stages go with goal^-power, about

class Clock {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Thrown out of a draft's gather: it has said what it was for.
struct DraftIsEnough {};

class InTime {
 public:
  InTime(const BakeOptions& options, Progress& progress, Targets& targets)
      : draft_(options),
        better_(options),
        end_s_(kFill * options.time_s),
        full_s_(kFull * options.time_s),
        progress_(progress),
        targets_(targets) {
    draft_.goal = kDraft;
    draft_.goalIsExplicit = false;
    draft_.audit = better_.audit = Audit::Off;  // its rays would not be counted in the time that is left
    better_.goalIsExplicit = false;
  }

  std::unique_ptr<Work> bake() {
    auto draft = std::make_unique<Work>(draft_, progress_);
    draft->b.goOn = [&](double goal, std::uint64_t rays) {
      const double now = clock_.seconds();
      if (draft->b.map.rounds == 0 && end_s_ - now - after(*draft) > kWorthwhile * (now - draft->secondsOf("occlude")))
        throw DraftIsEnough{};
      return another(*draft, goal, rays);
    };
    double gather_s = 0.0;
    try {
      run(*draft, nullptr);
      gather_s = draft->secondsOf("gather");
      if (clock_.seconds() * (1.0 + kWorthwhile) > end_s_) return draft;
    } catch (const DraftIsEnough&) {
      gather_s = clock_.seconds() - gatherBegun_s_;
    }
    better_.goal = goalFor(kBaseShare * (end_s_ - clock_.seconds()), *draft, gather_s);
    auto better = std::make_unique<Work>(better_, progress_);
    better->b.goOn = [&, work = better.get()](double goal, std::uint64_t rays) { return another(*work, goal, rays); };
    progress_.say(fmt::format("draft done after {:.1f} s: a goal of {} next, and rounds of rays as long as there is time", clock_.seconds(),
                              figure(better_.goal)));
    run(*better, draft.get());
    return better;
  }

  double seconds() const { return clock_.seconds(); }

 private:
  /// Openness does not depend on the goal: the draft's serves both, and its seconds are known before rounds begin.
  void run(Work& work, Work* before) {
    const auto occludes = [](const StageRow& s) { return s.work == occlude; };
    if (before) work.b.paging = before->b.paging;
    for (const StageRow& stage : kStages) {
      if (stage.work == hemisphere) {
        if (before) {
          work.b.openness = std::move(before->b.openness);
          if (before->b.tracer)
            work.b.occlusionRaysBefore = before->b.tracer->rays(Purpose::Occlusion) - before->b.pilotRays[std::size_t(Purpose::Occlusion)];
          const auto told = std::ranges::find(before->spoken.stages, std::string("occlude"), &StageTime::name);
          if (told != before->spoken.stages.end()) work.spoken.stages.push_back(*told);
        } else {
          work.perform(*std::ranges::find_if(kStages, occludes));
        }
        gatherBegun_s_ = clock_.seconds();
      }
      if (!occludes(stage)) work.perform(stage);
      targets_.open(work.b);
    }
  }

  /// Values, seams and files take about as long as reading and charts did.
  double after(const Work& work) const { return work.secondsOf("load") + work.secondsOf("charts"); }

  /// Whether a round of so many rays towards a goal is to be cast: if there is time left, and it ends in time at the pace of the last
  /// round.
  bool another(const Work& work, double goal, std::uint64_t rays) {
    const double now = clock_.seconds(), cast = double(work.b.tracer->rays() - work.raysBefore);
    if (work.b.map.rounds == 0) {
      asked_s_ = gatherBegun_s_;
      askedRays_ = 0.0;
    }
    // A round that had nothing to cast says nothing of the pace.
    if (cast > askedRays_) {
      pace_s_ = (now - asked_s_) / (cast - askedRays_);
      asked_s_ = now;
      askedRays_ = cast;
    }
    return goal >= kFinest * kRoundStep && now + after(work) < end_s_ && now + pace_s_ * double(rays) + after(work) <= full_s_;
  }

  double goalFor(double seconds, const Work& draft, double gather_s) const {
    const double direct = draft.secondsOf("direct"), patches = draft.secondsOf("patches") + draft.secondsOf("solve"),
                 rest = 2.0 * after(draft) + draft.secondsOf("trace");
    const auto takes = [&](double goal) {
      const double finer = kDraft / goal;
      return rest + direct * std::pow(finer, kDirectPower) + patches * std::pow(finer, kPatchPower) +
             gather_s * std::pow(finer, kGatherPower);
    };
    double lo = kFinest, hi = kDraft;
    if (takes(lo) <= seconds) return lo;
    for (int k = 0; k < 40; ++k) {
      const double middle = std::sqrt(lo * hi);
      (takes(middle) <= seconds ? hi : lo) = middle;
    }
    return std::round(1e4 * hi) / 100.0 / 100.0;  // a percentage of two digits, as --max-error reads it
  }

  BakeOptions draft_, better_;
  double end_s_, full_s_, gatherBegun_s_ = 0.0;
  double asked_s_ = 0.0, askedRays_ = 0.0, pace_s_ = 0.0;  ///< when the last round was asked for, and the rays of the stage until then
  Progress& progress_;
  Targets& targets_;
  Clock clock_;
};

std::unique_ptr<Work> inOrder(const BakeOptions& options, Progress& progress, Targets& targets) {
  auto work = std::make_unique<Work>(options, progress);
  for (const StageRow& stage : kStages) {
    if (stage.work == directLight) targets.goOn(work->b);
    work->perform(stage);
    targets.open(work->b);
  }
  return work;
}

/// Done, or GoalMissed with a warning.
Exit judge(const Bake& b, bool met) {
  const BakeOptions& o = b.options;
  Exit result = Exit::Done;
  if (!met && o.goalIsExplicit) {
    result = Exit::GoalMissed;
    b.run.warn(
        {{},
         o.level.string(),
         "",
         fmt::format("the goal of {} was missed: error {}, at most {}; worst object '{}' at most {}", figure(o.goal),
                     figure(b.ledger.estimate), figure(b.ledger.bound95),
                     b.ledger.worstObjectId == kNone ? "" : b.scene.objects[b.ledger.worstObjectId].path, figure(b.ledger.worstObject)),
         "LMC_GOAL"});
  }
  if (b.openness.asked > 0 && b.openness.rmsError > o.ao.how.error && o.ao.errorIsExplicit) {
    result = Exit::GoalMissed;
    b.run.warn({{},
                o.level.string(),
                "",
                fmt::format("the goal of {} for ambient occlusion was missed: error {:.4f}", o.ao.how.error, b.openness.rmsError),
                "LMC_GOAL"});
  }
  return result;
}

}  // namespace

Run stoppableRun(int threads) {
  Run run;
  run.threads = threads;
  run.stop = [] { return stopSignal != 0; };
  return run;
}

void askToStop(int signal) { stopSignal = signal; }
int askedToStop() { return stopSignal; }

namespace {

Exit bakeInto(Targets& targets, const BakeOptions& options, Progress& progress) {
  Exit result = Exit::Done;
  withThreads(Run{options.threads}, [&] {
    std::optional<InTime> inTime;
    if (options.time_s > 0.0) inTime.emplace(options, progress, targets);
    const std::unique_ptr<Work> work = inTime ? inTime->bake() : inOrder(options, progress, targets);
    const Bake& b = work->b;
    const bool met = b.ledger.bound95 <= b.options.goal && b.ledger.worstObject <= kObjectLimit * b.options.goal;
    result = judge(b, met);
    if (inTime && inTime->seconds() > kOver * options.time_s) {
      result = Exit::GoalMissed;
      b.run.warn({{},
                  options.level.string(),
                  "",
                  fmt::format("--time {:g} s was missed: this level takes {:.1f} s at least, which gave an error of {}", options.time_s,
                              inTime->seconds(), figure(b.ledger.estimate)),
                  "LMC_TIME"});
    }
    nlohmann::ordered_json report = reportOf(b, work->spoken, met);
    if (inTime)
      report["time"] = {{"asked_s", options.time_s},
                        {"seconds", inTime->seconds()},
                        {"same_bytes_by", fmt::format("--max-error {:g}% --gather-rounds {}", 100.0 * b.options.goal, b.map.rounds)}};
    if (targets.journal) report["resume"] = resumeOf(*targets.journal);
    writeOutputs(*targets.outputs, b, report);
    if (targets.dependencies) targets.dependencies->open(options.depfile.filename()).write(depfileText(b));
    b.run.progress(1.0);  // the last moment to stop
    if (targets.dependencies) targets.dependencies->commit();
    targets.outputs->commit();
    if (targets.journal) targets.journal->remove();
    if (options.json)
      fmt::print("{}\n", report.dump(2));
    else if (options.explain)
      fmt::print("{}", explainText(b.explained));
    if (options.progress == ProgressKind::None || options.progress == ProgressKind::Json) return;
    progress.say(fmt::format("baked {} in {:.1f} s ({:.1f} CPU s, {:.0f} MB): error {}, at most {} ({})", options.out.string(),
                             inTime ? inTime->seconds() : double(report["seconds"]), double(report["cpu_seconds"]),
                             double(peakBytes()) / 1e6, figure(b.ledger.estimate), figure(b.ledger.bound95),
                             inTime ? std::string(report["time"]["same_bytes_by"]) : fmt::format("goal {}", figure(options.goal))));
  });
  return result;
}

}  // namespace

Exit bake(const BakeOptions& options) {
  Progress progress(options.progress);
  Targets targets;
  const auto goesOn = [&] {
    if (targets.journal && targets.journal->tilesKept() > 0) progress.say(goesOnText(*targets.journal, options, progress.done()));
  };
  try {
    return bakeInto(targets, options, progress);
  } catch (const Cancelled&) {
    goesOn();
    throw;
  } catch (const Error& e) {
    if (mayGoOn(e))
      goesOn();
    else if (targets.journal)
      targets.journal->remove();
    throw;
  } catch (const std::bad_alloc&) {
    goesOn();
    throw;
  } catch (const std::exception&) {  // a fault of lmc, which would come again
    if (targets.journal) targets.journal->remove();
    throw;
  }
}

Exit showPlan(const PlanOptions& options) {
  Progress progress(ProgressKind::None);
  Work work(options.bake, progress);
  const Bake& b = work.b;
  const std::vector<StageTime>& stages = work.spoken.stages;
  withThreads(b.run, [&] {
    for (const StageRow& stage : kStages) {
      work.perform(stage);
      if (stage.work == pilot) break;
    }
  });
  if (options.bake.json)
    fmt::print("{}\n",
               nlohmann::ordered_json{{"plan", planOf(b, stages)}, {"forecast", forecastOf(b, stages)}, {"facts", factsOf(b)}}.dump(2));
  else
    fmt::print("{}", planText(b, stages));
  return Exit::Done;
}

}  // namespace lmc
