#pragma once
/// What every stage gets besides its inputs: threads, seed, progress and a place for messages.
#include <cstdint>
#include <functional>

#include "libscene/error.h"

namespace lmc {

class Journal;

struct Run {
  int threads = 0;                                ///< 0 = all; never changes a result
  std::uint64_t seed = 1;                         ///< with the level and the options, all that a result depends on
  std::function<bool(double)> onProgress;         ///< share of the stage done in [0, 1]; return false to stop
  std::function<void(const Message&)> onMessage;  ///< warnings and notes; may be empty
  Journal* journal = nullptr;                     ///< where finished tiles are kept and looked up (journal.h); null = nowhere

  void progress(double share) const {
    if (onProgress && !onProgress(share)) throw Cancelled();
  }
  /// This run for a part of a stage: its progress counts from one share to another.
  Run part(double from, double to) const {
    Run out = *this;
    out.onProgress = [this, from, to](double share) {
      progress(from + (to - from) * share);
      return true;
    };
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
