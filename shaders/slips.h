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
  RedFlipped,
  TangentFlipped,
  ColourNotDecoded,
  NormalScaleIgnored,
  NormalMapIgnored,
  NormalByWorldMatrix,
  BackNotTurned,
  BaseDecodedTwice,
  BaseNotDecoded,
  MapScaleMissing,
  MapFlipped,
  SpecularUngated,
  ReflectionSign,
  ReflectArgumentsSwapped,
  HalfVector,
  SpecularMapIgnored,
  SpecularUnattenuated,
  DiffuseUnclamped,
  DiffuseAbsolute,
  PiMissing,
  PiTwice,
  PiInverted,
  QuadraticPrecedence,
  WindowMissing,
  ClassicWindowMissing,
  PhysicalWindowMissing,
  WindowPowerOutside,
  InverseDistance,
  ConeMissing,
  ConeNotSquared,
  StaticTwice,
  AoIgnored,
  AoOnDirect,
  AoOnDirectAlone,
  AlbedoMissing,
  AlbedoTimesPi,
  AlbedoOverPi,
  EmissionMissing,
  ExposureMissing,
};

/// Which passes a slip can be made in.
enum class SlipPlace : std::uint8_t { GBuffer, Light, Composite, ToneMap };

struct SlipRow {
  Slip slip;
  SlipPlace place;
  std::string_view name;   ///< stable, for tests and scripts; several slips may be one fault
  std::string_view words;  ///< for a person
};
inline constexpr std::array<SlipRow, 43> kSlips{{
    {Slip::DeterminantFlipped, SlipPlace::GBuffer, "flipped-determinant",
     "the determinant is flipped (or the arguments of cross(normal, tangent), or green where normals are in tangent space)"},
    {Slip::DeterminantIgnored, SlipPlace::GBuffer, "determinant-ignored",
     "the determinant is left out: mirrored UVs are lit from the wrong side"},
    {Slip::MirrorIgnored, SlipPlace::GBuffer, "node-mirror-ignored", "the bitangent does not follow a node that mirrors (worldMirror)"},
    {Slip::GreenFlipped, SlipPlace::GBuffer, "flipped-green", "green of the normal map is flipped"},
    {Slip::RedFlipped, SlipPlace::GBuffer, "flipped-red", "red of the normal map is flipped"},
    {Slip::TangentFlipped, SlipPlace::GBuffer, "flipped-red", "red of normal maps in tangent space is flipped, or the tangent is"},
    {Slip::NormalScaleIgnored, SlipPlace::GBuffer, "normal-scale-ignored", "normalTexture.scale has no effect"},
    {Slip::ColourNotDecoded, SlipPlace::GBuffer, "normal-not-decoded",
     "the colour of the normal map is not brought from [0, 1] to [-1, 1]"},
    {Slip::NormalMapIgnored, SlipPlace::GBuffer, "normal-map-ignored", "the normal map has no effect"},
    {Slip::NormalByWorldMatrix, SlipPlace::GBuffer, "normal-by-world-matrix",
     "normals go by the world matrix, not by its inverse transpose"},
    {Slip::BackNotTurned, SlipPlace::GBuffer, "back-not-turned", "the normal of the back of a double-sided surface is not turned about"},
    {Slip::BaseDecodedTwice, SlipPlace::GBuffer, "gamma", "the base colour is decoded (power 2.2) though its texture has done so"},
    {Slip::BaseNotDecoded, SlipPlace::GBuffer, "gamma", "the base colour is gamma-encoded (power 1/2.2): albedo is linear"},
    {Slip::MapScaleMissing, SlipPlace::GBuffer, "light-map-scale-missing", "the scale of the light map is left out: E = texel * scale"},
    {Slip::MapFlipped, SlipPlace::GBuffer, "light-map-flipped", "the light map is upside down: its first row is V = 0"},
    {Slip::SpecularUngated, SlipPlace::Light, "missing-n.l-gate",
     "the n.l > 0 gate of the specular term is missing: surfaces shine that face away"},
    {Slip::ReflectionSign, SlipPlace::Light, "reflection-sign",
     "the reflection vector has the opposite sign: r = L - 2 (n.L) n with L towards the surface"},
    {Slip::ReflectArgumentsSwapped, SlipPlace::Light, "reflect-arguments",
     "the arguments of reflect() are swapped: it takes (incident, normal)"},
    {Slip::HalfVector, SlipPlace::Light, "half-vector",
     "the half vector n.h stands in place of the reflection r.v: another lobe for the same power"},
    {Slip::SpecularMapIgnored, SlipPlace::Light, "specular-map-ignored", "the specular colour of the surface has no effect"},
    {Slip::SpecularUnattenuated, SlipPlace::Light, "specular-unattenuated", "the specular term has no attenuation"},
    {Slip::DiffuseUnclamped, SlipPlace::Light, "diffuse-unclamped", "n.l is not clamped: a light takes light from surfaces that face away"},
    {Slip::DiffuseAbsolute, SlipPlace::Light, "diffuse-unclamped", "|n.l| in place of n.l: surfaces are lit from behind"},
    {Slip::PiMissing, SlipPlace::Light, "pi", "1/pi is missing: a light of candela or lux gives E, a surface shows E/pi"},
    {Slip::PiTwice, SlipPlace::Light, "pi", "light of candela or lux is divided by pi twice"},
    {Slip::PiInverted, SlipPlace::Light, "pi", "light of candela or lux is multiplied by pi where it should be divided"},
    {Slip::QuadraticPrecedence, SlipPlace::Light, "attenuation-range", "1/range*range is 1: the quadratic factor is 1/(range * range)"},
    {Slip::WindowMissing, SlipPlace::Light, "range-window-missing", "the range does not end the light: the window is missing"},
    {Slip::ClassicWindowMissing, SlipPlace::Light, "range-window-missing",
     "the range does not end classic lights: saturate(1 - (d/range)^power) is missing"},
    {Slip::PhysicalWindowMissing, SlipPlace::Light, "range-window-missing",
     "the range does not end physical lights: saturate(1 - (d/range)^4) is missing"},
    {Slip::WindowPowerOutside, SlipPlace::Light, "range-power-outside", "the power is taken of the difference, not of d/range"},
    {Slip::InverseDistance, SlipPlace::Light, "inverse-distance", "light falls with 1/d, not with 1/d^2"},
    {Slip::ConeMissing, SlipPlace::Light, "cone-missing", "the spot has no cone"},
    {Slip::ConeNotSquared, SlipPlace::Light, "cone-not-squared", "the fall-off of the cone is not squared"},
    {Slip::StaticTwice, SlipPlace::Light, "static-light-twice", "lights that are in the light map are drawn again"},
    {Slip::AoIgnored, SlipPlace::Composite, "ao-ignored", "ambient occlusion has no effect"},
    {Slip::AoOnDirect, SlipPlace::Composite, "ao-on-direct", "ambient occlusion scales the direct part, not the ambient part alone"},
    {Slip::AoOnDirectAlone, SlipPlace::Composite, "ao-on-direct", "ambient occlusion scales the direct part in place of the ambient part"},
    {Slip::AlbedoTimesPi, SlipPlace::Composite, "pi", "light times surface is pi times too bright: it is E/pi already"},
    {Slip::AlbedoOverPi, SlipPlace::Composite, "pi", "light times surface is divided by pi, though the light passes have done so"},
    {Slip::AlbedoMissing, SlipPlace::Composite, "albedo-missing", "light is not multiplied by the surface: surface * lightMap"},
    {Slip::EmissionMissing, SlipPlace::Composite, "emission-missing", "what surfaces emit is left out"},
    {Slip::ExposureMissing, SlipPlace::ToneMap, "exposure-missing", "the exposure has no effect"},
}};

}  // namespace lmc::shaders
