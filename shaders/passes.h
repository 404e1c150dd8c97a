#pragma once
/// The passes of the reference shader, in the order in which they are drawn, and the files that they are made of.
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "shaders/view.h"

namespace lmc::shaders {

enum class Pass : std::uint8_t { GBuffers, GBuffersBump, LightMap, Directional, Point, Spot, Ssao, Composite, ToneMap };

struct PassRow {
  Pass pass;
  std::string_view name, vertex, fragment;
  std::vector<Target> targets;  ///< that it writes
};
inline const std::array<PassRow, 9> kPasses{{
    {Pass::GBuffers,
     "gbuffers",
     "deferred/gbuffers.vert",
     "deferred/gbuffers.frag",
     {Target::Diffuse, Target::Specular, Target::Normal, Target::Depth, Target::Baked, Target::Emission}},
    {Pass::GBuffersBump,
     "gbuffers_bump",
     "deferred/gbuffers_bump.vert",
     "deferred/gbuffers_bump.frag",
     {Target::Diffuse, Target::Specular, Target::Normal, Target::Depth, Target::Baked, Target::Emission}},
    {Pass::LightMap, "lightmap", "deferred/screen.vert", "deferred/lightmap.frag", {Target::AmbientLight, Target::DiffuseLight}},
    {Pass::Directional,
     "directional",
     "deferred/screen.vert",
     "deferred/directional.frag",
     {Target::AmbientLight, Target::DiffuseLight, Target::SpecularLight}},
    {Pass::Point,
     "point",
     "deferred/volume.vert",
     "deferred/point.frag",
     {Target::AmbientLight, Target::DiffuseLight, Target::SpecularLight}},
    {Pass::Spot, "spot", "deferred/volume.vert", "deferred/spot.frag", {Target::AmbientLight, Target::DiffuseLight, Target::SpecularLight}},
    {Pass::Ssao, "ssao", "deferred/screen.vert", "deferred/ssao.frag", {Target::ScreenAo}},
    {Pass::Composite, "composite", "deferred/screen.vert", "deferred/composite.frag", {Target::Radiance}},
    {Pass::ToneMap, "tonemap", "deferred/screen.vert", "deferred/tonemap.frag", {Target::Picture}},
}};

/// A shader whose includes have been put in their places.
struct ShaderText {
  struct Line {
    std::size_t file;  ///< into files
    int number;        ///< in that file, from 1
  };
  std::string text;
  std::vector<Line> lines;                   ///< where each line of the text comes from; those of the prologue are the first file's line 0
  std::vector<std::filesystem::path> files;  ///< a name such as common/lighting.glsl where the file is lmc's own
  bool replaced = false;                     ///< a file of the user's folder is among them
};

/// The shader `name` (such as deferred/point.frag) for GL 3.3. Each file is taken from `folder` where that has it, by its whole name or by
/// the last part of it; else from the program; an empty folder has none. Throws Error for an include that is nowhere.
ShaderText shaderText(std::string_view name, const std::filesystem::path& folder);

/// Names of all files that lmc has, includes among them.
std::vector<std::string_view> shaderNames();

/// For a user: "0:L(C): error: ..." of a compiler's log as "FILE:L: error: ...", L being the line in that file. (`#line` would do the same
/// if Mesa kept its second number.)
std::string namedLog(std::string_view log, const ShaderText&);

}  // namespace lmc::shaders
