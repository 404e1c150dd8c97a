#pragma once
/// Pictures as functions of a place, in double precision: bilinear, level 0, whatever filter a file names.
#include "libscene/shading.h"

namespace lmc::shaders {

/// Colour by IEC 61966-2-1, alpha as it is.
glm::dvec4 linearOfSrgb(glm::u8vec4 stored);
double encodedSrgb(double linear);  ///< of [0, 1]

enum class Encoding : std::uint8_t { Srgb, Linear };

/// White where there is no texture. `uv` before the texture's transform.
glm::dvec4 sample(const Scene&, const Texture&, const glm::dvec2& uv, Encoding);

/// A map of a bake, clamped at its borders.
glm::dvec3 sample(const Image<Rgb>&, const glm::dvec2& uv);
double sample(const Image<float>&, const glm::dvec2& uv);

}  // namespace lmc::shaders
