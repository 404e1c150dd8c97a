#pragma once
/// A level and its maps for the reference shader: a bake's folder, or a level that was not baked.
#include "libscene/run.h"
#include "shaders/view.h"

namespace lmc {

struct LoadedLevel {
  ShadingLevel level;
  shaders::LevelMaps maps;
};

/// Tangents are made where a normal map wants them and the file has none. A level without maps and lights gets one at the camera, with a
/// note.
LoadedLevel loadForShader(const std::filesystem::path& levelOrFolder, const std::string& camera, const Run&);

/// By the name of a camera of the level, by px,py,pz,tx,ty,tz,fov, or, for no wish, the level's first or one made. Throws Error Usage.
Camera cameraFor(const Scene&, const std::string& wish);

}  // namespace lmc
