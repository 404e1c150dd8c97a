#pragma once
/// Ambient occlusion as files and reports have it, and `lmc ao`.
#include <nlohmann/json.hpp>
#include <span>

#include "libao/ao.h"
#include "libscene/files.h"
#include "libscene/image.h"
#include "libscene/padding.h"
#include "lmc/options.h"

namespace lmc {

/// A note that names --ao-distance where more than 90 % of the texels are below 0.01.
void noteDarkness(const ao::Openness&, const ao::Options&, const std::filesystem::path& level, const Run&);

nlohmann::ordered_json aoOf(const ao::Openness&, const ao::Options&);

/// Bent normals turn from the world to the tangent space of TEXCOORD_0. `place`: of each vertex in the maps, [0, 1].
void bentToTangentSpace(ao::Openness&, const Scene&, std::span<const glm::vec2> place, int width, int height, const Run&);

/// Texels outside the charts get the values of those that they repeat.
void padOpenness(ao::Openness&, const Padding&);

/// Channels Y (cosine), uniform.Y, stderr.Y and bent.R, G, B where there are bent normals, of `side` x `side` texels from `first` on.
void writeOpenness(OutputFile&, const ao::Openness&, std::size_t first, int side);

/// The same as a grey picture; white where nothing is shown.
Image<glm::u8vec4> pictureOfOpenness(std::span<const float> shown, const Padding&, std::size_t first, int side);

/// The verb.
Exit occlusion(const AoJobOptions&);

}  // namespace lmc
