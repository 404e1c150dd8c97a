#pragma once
/// The GLSL files as the build found them; embedded.cpp is written by embed.cmake.
#include <span>
#include <string_view>

namespace lmc::shaders {

struct EmbeddedShader {
  std::string_view name;  ///< below this folder, such as deferred/point.frag
  std::string_view text;
};
extern const std::span<const EmbeddedShader> kEmbeddedShaders;

}  // namespace lmc::shaders
