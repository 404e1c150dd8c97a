#pragma once
/// Materials as functions of a place on a triangle.
#include "libscene/scene.h"

namespace lmc {

/// All take barycentric coordinates (b1, b2) of the second and third corner.
/// Diffuse reflectance: base colour factor * texture * COLOR_0 * (1 - metallic), each channel clamped to [0, 1].
Rgb reflectanceAt(const Scene&, std::uint32_t triangle, glm::vec2 bary);
/// Emitted radiance [cd/m^2], front face.
Rgb emissionAt(const Scene&, std::uint32_t triangle, glm::vec2 bary);
/// Alpha of base colour factor * texture * COLOR_0; below the cut-off of a Mask material a ray goes through.
float alphaAt(const Scene&, std::uint32_t triangle, glm::vec2 bary);

/// Area means over a whole triangle (for Mask materials over its opaque part). Exact for untextured materials; else by up
/// to 4096 stratified points, about one a texture texel.
Rgb meanReflectance(const Scene&, std::uint32_t triangle);
Rgb meanEmission(const Scene&, std::uint32_t triangle);

}  // namespace lmc
