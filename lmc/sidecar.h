#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>

namespace lmc {

/// level.lmc.json of a bake. Throws Error where it is none, or where a file is not the one that it speaks of.
nlohmann::json readSidecar(const std::filesystem::path& folder);

}  // namespace lmc
