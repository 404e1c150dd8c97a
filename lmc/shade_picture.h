#pragma once
/// Frames of the reference shader as files.
#include <filesystem>
#include <string>

#include "shaders/view.h"

namespace lmc {

/// What of a frame is looked at: a target, or its alpha channel.
struct Looked {
  shaders::Target target;
  bool alpha = false;
};
/// By a name of `lmc shade --view`, which must be one.
Looked lookedAt(const std::string& view);

/// For eyes: light exposed (0 = so that the picture is neither dark nor white) and sRGB-encoded as colours are, depth from white (near) to
/// grey, the rest as it is.
Image<glm::vec4> shownPicture(const shaders::Frame&, const Looked&, double exposure);
/// As it is, but light times the exposure; the light map as a white surface shows it, E/pi.
Image<glm::vec4> rawPicture(const shaders::Frame&, const Looked&, double exposure);

/// [0, 1] to 8 bits; what is not finite becomes white.
Image<glm::u8vec4> quantised(const Image<glm::vec4>&);
void writePng(const std::filesystem::path&, const Image<glm::u8vec4>&);
/// EXR of halves: R, G, B, cut off at what a half holds.
void writeLinear(const std::filesystem::path&, Image<glm::vec4>);

}  // namespace lmc
