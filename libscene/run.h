#pragma once
/// What every stage gets besides its inputs: threads, seed, progress and a place for messages.
#include <cstdint>
#include <functional>

#include "libscene/error.h"

namespace lmc {

class Journal;

struct Run {
  int threads = 0;                                  ///< 0 = all; never changes a result
  std::uint64_t seed = 1;                           ///< with the level and the options, all that a result depends on
  std::function<void(double)> onProgress{};         ///< share of the stage done in [0, 1]
  std::function<void(const Message&)> onMessage{};  ///< warnings and notes; may be empty
  Journal* journal = nullptr;                       ///< where finished tiles are kept and looked up (journal.h); null = nowhere
  std::function<bool()> stop{};                     ///< whether to stop; any thread asks, and often

  /// Throws Cancelled, as progress() does.
  void checkStop() const {
    if (stop && stop()) throw Cancelled();
  }
  void progress(double share) const {
    checkStop();
    if (onProgress) onProgress(share);
  }
  /// This run for a part of a stage: its progress counts from one share to another.
  Run part(double from, double to) const {
    Run out = *this;
    if (onProgress) out.onProgress = [report = onProgress, from, to](double share) { report(from + (to - from) * share); };
    return out;
  }
  /// This run for work that is no known share of the stage.
  Run quiet() const {
    Run out = *this;
    out.onProgress = {};
    return out;
  }
  /// This run for work beside what it is for: it can be stopped, but says nothing and keeps no tiles.
  Run silent() const {
    Run out = quiet();
    out.onMessage = {};
    out.journal = nullptr;
    return out;
  }
  void note(Message m) const {
    m.level = Message::Level::Note;
    if (onMessage) onMessage(m);
  }
  void warn(Message m) const {
    m.level = Message::Level::Warning;
    if (onMessage) onMessage(m);
  }
};

}  // namespace lmc
