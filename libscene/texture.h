#pragma once
/// Materials as functions of a place on a triangle.
#include <array>

#include "libscene/scene.h"

namespace lmc {

/// Of linear Rec. 709 colours (ITU-R BT.709-6, item 3.2): what a grey of the same luminance has in each channel.
inline float luminance(const Rgb& c) { return 0.2126f * c.r + 0.7152f * c.g + 0.0722f * c.b; }

/// All take barycentric coordinates (b1, b2) of the second and third corner.
/// Diffuse reflectance: base colour factor * texture * COLOR_0 * (1 - metallic), each channel clamped to [0, 1].
Rgb reflectanceAt(const Scene&, std::uint32_t triangle, glm::vec2 bary);
/// Emitted radiance [cd/m^2], front face.
Rgb emissionAt(const Scene&, std::uint32_t triangle, glm::vec2 bary);
/// Alpha of base colour factor * texture * COLOR_0; below the cut-off of a Mask material a ray goes through.
float alphaAt(const Scene&, std::uint32_t triangle, glm::vec2 bary);

/// Area mean over a part of a triangle with these corners (for Mask materials over what is opaque of it; black where nothing is). Exact
/// for untextured materials; else by up to 4096 stratified points, about one a texture texel.
Rgb meanReflectance(const Scene&, std::uint32_t triangle,
                    const std::array<glm::vec2, 3>& part = {glm::vec2(0.0f), glm::vec2(1.0f, 0.0f), glm::vec2(0.0f, 1.0f)});

}  // namespace lmc
