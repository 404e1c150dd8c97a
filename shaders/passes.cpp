#include "shaders/passes.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "libscene/files.h"
#include "shaders/embedded.h"

namespace lmc::shaders {

namespace {

constexpr std::size_t kMaxFiles = 64;               // of one shader: more includes include one another
constexpr std::uint64_t kMaxShaderBytes = 1 << 20;  // a hundred times the largest

struct Source {
  std::filesystem::path file;
  std::string text;
  bool own = false;  ///< from the user's folder
};

Source readSource(std::string_view name, const std::filesystem::path& folder, const std::filesystem::path& from) {
  std::error_code missing;
  if (!folder.empty())
    for (const std::filesystem::path& file : {folder / name, folder / std::filesystem::path(name).filename()})
      if (std::filesystem::exists(file, missing)) {
        const std::vector<std::uint8_t> bytes = readFile(file, kMaxShaderBytes);
        return {file, std::string(bytes.begin(), bytes.end()), true};
      }
  for (const EmbeddedShader& e : kEmbeddedShaders)
    if (e.name == name) return {std::filesystem::path(name), std::string(e.text), false};
  throw Error(Exit::Io, from, "", fmt::format("includes \"{}\", which is neither in the folder nor one of lmc's own", name), "LMC_SHADER");
}

/// The file of a line such as `#include "common/light.glsl"`, or nothing.
std::string_view includedBy(std::string_view line) {
  const std::size_t start = line.find_first_not_of(" \t");
  if (start == std::string_view::npos || !line.substr(start).starts_with("#include")) return {};
  const std::size_t open = line.find('"'), close = line.find('"', open + 1);
  return close == std::string_view::npos ? std::string_view() : line.substr(open + 1, close - open - 1);
}

void append(ShaderText& out, std::string_view name, const std::filesystem::path& folder, const std::filesystem::path& from) {
  if (out.files.size() >= kMaxFiles) throw Error(Exit::Broken, from, "", "includes files that include one another", "LMC_SHADER");
  const Source source = readSource(name, folder, from);
  const std::size_t index = out.files.size();
  out.files.push_back(source.file);
  out.replaced |= source.own;
  int number = 0;
  for (std::size_t at = 0; at < source.text.size();) {
    const std::size_t end = std::min(source.text.find('\n', at), source.text.size());
    const std::string_view line = std::string_view(source.text).substr(at, end - at);
    at = end + 1;
    ++number;
    if (const std::string_view included = includedBy(line); !included.empty()) {
      append(out, included, folder, source.file);
    } else if (!line.starts_with("#version")) {  // the prologue has said it
      out.text += line;
      out.text += '\n';
      out.lines.push_back({index, number});
    }
  }
}

}  // namespace

ShaderText shaderText(std::string_view name, const std::filesystem::path& folder) {
  ShaderText out;
  out.text = "#version 330 core\n";
  out.lines.assign(std::size_t(std::ranges::count(out.text, '\n')), {0, 0});
  append(out, name, folder, name);
  return out;
}

std::vector<std::string_view> shaderNames() {
  std::vector<std::string_view> out;
  for (const EmbeddedShader& e : kEmbeddedShaders) out.push_back(e.name);
  return out;
}

std::string namedLog(std::string_view log, const ShaderText& shader) {
  constexpr std::string_view kSource = "0:";  // of the one string that was compiled
  std::string out;
  for (std::size_t at = 0; at < log.size();) {
    const std::size_t end = std::min(log.find('\n', at), log.size());
    const std::string_view line = log.substr(at, end - at);
    at = end + 1;
    std::size_t number = 0;
    const std::size_t colon = line.find(':'), text = line.find(": ");
    const bool placed = line.starts_with(kSource) && text != std::string_view::npos &&
                        std::from_chars(line.data() + colon + 1, line.data() + line.size(), number).ec == std::errc() && number >= 1 &&
                        number <= shader.lines.size();
    if (placed) {
      const ShaderText::Line& from = shader.lines[number - 1];
      out += fmt::format("{}:{}{}\n", shader.files[from.file].string(), from.number, line.substr(text));
    } else if (!line.empty()) {
      out += line;
      out += '\n';
    }
  }
  return out;
}

}  // namespace lmc::shaders
