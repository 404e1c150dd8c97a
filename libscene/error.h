#pragma once
/// What a user can mend. Bugs are assert()s; expected outcomes are values.
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

namespace lmc {

/// Also the exit code of the program; docs/exit-codes.md says each in words.
enum class Exit : int {
  Done = 0,
  Usage = 1,        ///< the command line
  Io = 2,           ///< missing, unreadable, not writable
  Broken = 3,       ///< the level is broken; `where` is a JSON pointer
  Unsupported = 4,  ///< the level needs a feature that lmc does not have
  GoalMissed = 5,   ///< an explicit goal was missed; maps are written
  Numerical = 6,    ///< a numerical check failed; maps are not written
  Differs = 7,      ///< compare or check-shader above its limit
  Limit = 8,        ///< space, quota, memory or a size limit
  Internal = 9,
  Interrupted = 130,
  Terminated = 143,
};

/// One line for a person: "FILE:WHERE: error: WHAT [CODE]".
struct Error : std::runtime_error {
  Error(Exit kind_, const std::filesystem::path& file_, std::string_view where_, std::string_view what_, std::string_view code_ = {});
  Exit kind;
  std::string file;   ///< as the user named it; may be empty
  std::string where;  ///< a JSON pointer such as "/meshes/3", or empty
  std::string text;   ///< one sentence, no full stop
  std::string code;   ///< stable name such as "LMC_REFERENCE", or empty
};

/// Something worth saying that does not end the run.
struct Message {
  enum class Level { Note, Warning } level = Level::Note;
  std::string file, where, text, code;
};

/// "FILE:WHERE: KIND: TEXT [CODE]" with control characters escaped, on one line; parts that are empty are left out.
std::string line(std::string_view kind, std::string_view file, std::string_view where, std::string_view text, std::string_view code);

/// Thrown by a stage that Run::stop told to stop.
struct Cancelled : std::runtime_error {
  Cancelled() : std::runtime_error("stopped") {}
};

}  // namespace lmc
