#pragma once
/// The page of a study: one HTML file with plot, table and pictures inside, for a screen and for paper.
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace lmc {

struct PagePictures {
  std::vector<std::filesystem::path> maps;        ///< of a rung, in order
  std::vector<std::filesystem::path> references;  ///< may be empty
  std::vector<std::filesystem::path> finest;      ///< maps of the last rung; empty for itself
  bool openness = false;
};

/// `study`: what study.json holds; `svg`: the plot; `pictures`: one a row of study["rungs"].
std::string pageOf(const nlohmann::ordered_json& study, const std::string& svg, const std::vector<PagePictures>& pictures);

}  // namespace lmc
