#pragma once
/// Which effects run, which do not, and why. Pure: no file is touched and no ray is cast, so that every rule of leaving out has a test.
#include <optional>
#include <string>
#include <vector>

#include "lmc/facts.h"

namespace lmc {

/// What may be left out of a goal: a quarter, for the level, and of the limit of each object (design.md section 5).
inline constexpr double kLeftOutShare = 0.25;

struct Step {
  Effect effect;
  bool run;
  std::string because;
  bool possible = true;  ///< it would do something if it were asked for
  bool asked = false;    ///< it runs, or does not, because a user said so
  bool tooWeak = false;  ///< left out for its bound: that is part of the stated error
  Contribution light{};  ///< of the pilot
};
struct Plan {
  std::vector<Step> steps;
  double leftOut = 0.0;        ///< bound of all that was left out as too weak, relative to the level's mean
  double leftOutObject = 0.0;  ///< the same of the worst object, against max(its own mean, 1 % of the level's)
  bool runs(Effect e) const {
    for (const Step& s : steps)
      if (s.effect == e) return s.run;
    return false;
  }
  /// Whether its light belongs to the map: it runs, or was left out because it gives nothing, or too little. What checks a map has it.
  bool isMeant(Effect e) const {
    for (const Step& s : steps)
      if (s.effect == e) return s.run || !s.asked;
    return false;
  }
  /// Whether anything is simulated.
  bool anything() const {
    for (const Step& s : steps)
      if (s.run && isSimulated(s.effect)) return true;
    return false;
  }
};

struct PlanRequest {
  std::string effects = "auto";  ///< "auto", a list (exactly these, each in the manner that the level calls for), or changes to auto
  double goal = 0.02;            ///< relative RMS error asked for
  bool countedBounces = false;   ///< --passes: no light may come that has bounced more often
};

/// An effect runs when it is asked for, or when the level calls for it: when it can do anything at all, by the facts, and when its bound,
/// by the pilot, is above what is left of the share of the goal kept for what is left out. The weakest go first. Throws Error Usage for a
/// name that it does not know.
Plan makePlan(const PlanRequest&, const Facts&);

/// What an effect is going to cost, where it has stages of its own; `with`: the effect in whose stages it is done.
struct Cost {
  std::optional<Forecast> forecast;
  std::optional<Effect> with;
};
Cost costOf(Effect, const Plan&, const Pilot&);

/// All that runs after the pilot.
Forecast forecastOf(const Plan&, const Pilot&);

}  // namespace lmc
