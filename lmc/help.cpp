#include "lmc/help.h"

#include <algorithm>

namespace lmc {

const char* const kFixedLimits =
    "Fixed limits: maps of 16384 x 16384 texels, also where the level's lightmap.resolution asks for more (exit code 8); lights of 1e18 cd "
    "or lx and emission of 1e18 cd/m^2, UVs of 1e6, 8192 members of one JSON object, 16 Mi elements or bytes that a file names but does "
    "not hold (exit code 3); 16 GiB of a journal (further tiles are not kept).";

const char* const kExitCodes =
    "Exit codes: 0 done and goal met, 1 command line, 2 missing, unreadable or not writable, 3 level is broken or above a limit, 4 needs a "
    "feature that is not supported, 5 explicit goal missed (maps written), 6 numerical check failed (maps not written), 7 compare or "
    "check-shader above its limit, 8 no space, memory or size limit, 9 internal error, 130/143 stopped.";

std::string wrapped(std::string_view text, std::size_t columns) {
  std::string out;
  std::size_t used = 0;
  while (!text.empty()) {
    const std::string_view word = text.substr(0, text.find(' '));
    text.remove_prefix(std::min(text.size(), word.size() + 1));
    if (used > 0) {
      const bool fits = used + 1 + word.size() <= columns;
      out += fits ? ' ' : '\n';
      used = fits ? used + 1 : 0;
    }
    out += word;
    used += word.size();
  }
  return out;
}

}  // namespace lmc
