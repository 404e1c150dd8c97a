#include "lmc/jobs.h"

#include <fmt/format.h>

#include "libscene/files.h"
#include "lmc/bake.h"
#include "lmc/progress.h"

namespace lmc {

Run talkingRun(int threads) {
  Run run = stoppableRun(threads);
  run.onMessage = [](const Message& m) {
    tell(fmt::format("{}\n", line(m.level == Message::Level::Warning ? "warning" : "note", m.file, m.where, m.text, m.code)));
  };
  return run;
}

void refuseSameFile(const std::filesystem::path& in, const Scene& scene, const std::filesystem::path& out) {
  std::error_code missing;
  for (const auto& input : scene.inputs)
    if (std::filesystem::equivalent(input, out, missing))
      throw Error(Exit::Usage, out, "", fmt::format("would be overwritten, and {} reads it: choose another file with -o", in.string()));
}

void writeBytes(const std::filesystem::path& file, const std::vector<std::uint8_t>& bytes) {
  writeFileWhole(file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace lmc
