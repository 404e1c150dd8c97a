#pragma once
/// Wrong forms of the formulas that people write, by name: what check-shader looks for when a picture differs.
#include <array>
#include <cstdint>
#include <string_view>

namespace lmc::shaders {

enum class Slip : std::uint8_t {
  None,
  DeterminantFlipped,
  DeterminantIgnored,
  MirrorIgnored,
  GreenFlipped,
  ColourNotDecoded,
  NormalMapIgnored,
  NormalByWorldMatrix,
  BackNotTurned,
  SpecularUngated,
  ReflectionSign,
  ReflectArgumentsSwapped,
  SpecularMapIgnored,
  SpecularUnattenuated,
  DiffuseUnclamped,
  QuadraticPrecedence,
  WindowMissing,
  WindowPowerOutside,
  InverseDistance,
  ConeMissing,
  ConeNotSquared,
  StaticTwice,
  AoIgnored,
  AoOnDirect,
  AlbedoMissing,
  EmissionMissing,
};

struct SlipRow {
  Slip slip;
  std::string_view name;   ///< stable, for tests and scripts
  std::string_view words;  ///< for a person
};
inline constexpr std::array<SlipRow, 25> kSlips{{
    {Slip::DeterminantFlipped, "flipped-determinant",
     "the determinant is flipped (or the arguments of cross(normal, tangent), or green where normals are in tangent space)"},
    {Slip::DeterminantIgnored, "determinant-ignored", "the determinant is left out: mirrored UVs are lit from the wrong side"},
    {Slip::MirrorIgnored, "node-mirror-ignored", "the bitangent does not follow a node that mirrors (worldMirror)"},
    {Slip::GreenFlipped, "flipped-green", "green of the normal map is flipped"},
    {Slip::ColourNotDecoded, "normal-not-decoded", "the colour of the normal map is not brought from [0, 1] to [-1, 1]"},
    {Slip::NormalMapIgnored, "normal-map-ignored", "the normal map has no effect"},
    {Slip::NormalByWorldMatrix, "normal-by-world-matrix", "normals go by the world matrix, not by its inverse transpose"},
    {Slip::BackNotTurned, "back-not-turned", "the normal of the back of a double-sided surface is not turned about"},
    {Slip::SpecularUngated, "missing-n.l-gate", "the n.l > 0 gate of the specular term is missing: surfaces shine that face away"},
    {Slip::ReflectionSign, "reflection-sign", "the reflection vector has the opposite sign: r = L - 2 (n.L) n with L towards the surface"},
    {Slip::ReflectArgumentsSwapped, "reflect-arguments", "the arguments of reflect() are swapped: it takes (incident, normal)"},
    {Slip::SpecularMapIgnored, "specular-map-ignored", "the specular colour of the surface has no effect"},
    {Slip::SpecularUnattenuated, "specular-unattenuated", "the specular term has no attenuation"},
    {Slip::DiffuseUnclamped, "diffuse-unclamped", "n.l is not clamped: a light takes light from surfaces that face away"},
    {Slip::QuadraticPrecedence, "attenuation-range", "1/range*range is 1: the quadratic factor is 1/(range * range)"},
    {Slip::WindowMissing, "range-window-missing", "the range does not end the light: saturate(1 - (d/range)^power) is missing"},
    {Slip::WindowPowerOutside, "range-power-outside", "the power is taken of the difference, not of d/range"},
    {Slip::InverseDistance, "inverse-distance", "light falls with 1/d, not with 1/d^2"},
    {Slip::ConeMissing, "cone-missing", "the spot has no cone"},
    {Slip::ConeNotSquared, "cone-not-squared", "the fall-off of the cone is not squared"},
    {Slip::StaticTwice, "static-light-twice", "lights that are in the light map are drawn again"},
    {Slip::AoIgnored, "ao-ignored", "ambient occlusion has no effect"},
    {Slip::AoOnDirect, "ao-on-direct", "ambient occlusion scales the direct part, not the ambient part alone"},
    {Slip::AlbedoMissing, "albedo-missing", "light is not multiplied by the surface: surface * lightMap"},
    {Slip::EmissionMissing, "emission-missing", "what surfaces emit is left out"},
}};

}  // namespace lmc::shaders
