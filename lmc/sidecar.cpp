#include "lmc/sidecar.h"

#include "libscene/files.h"

namespace lmc {

nlohmann::json readSidecar(const std::filesystem::path& folder) {
  const std::vector<std::uint8_t> sidecarText = readFile(folder / "level.lmc.json");
  const auto sidecar = nlohmann::json::parse(sidecarText, nullptr, false);
  if (sidecar.is_discarded() || !sidecar.contains("files"))
    throw Error(Exit::Broken, folder / "level.lmc.json", "", "is not a sidecar of lmc");
  for (const auto& f : sidecar["files"]) {
    const auto name = f.value("name", std::string());
    if (name.empty() || name.find('/') != std::string::npos || contentHash(readFile(folder / name)) != f.value("xxh3", std::string()))
      throw Error(Exit::Broken, folder / name, "", "is not the file that the sidecar speaks of: bake again", "LMC_HASH");
  }
  return sidecar;
}

}  // namespace lmc
