#pragma once
/// EXR images in and out (OpenEXR only in exr.cpp).
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "libscene/files.h"
#include "libscene/image.h"

namespace lmc {

/// One channel of a file to write: a name such as "indirect.R" and a view of floats, `stride` apart, rows from the top.
struct ExrChannel {
  std::string name;
  const float* data = nullptr;
  std::size_t stride = 1;
};

/// Half floats, PIZ. Attributes are written as floats. No time stamp: same input, same bytes.
/// Values above the half range or not finite must not come here: they are a bug of the caller, and asserted.
void writeExr(OutputFile&, int width, int height, const std::vector<ExrChannel>&, const std::map<std::string, float>& attributes = {});

struct ExrImage {
  int width = 0, height = 0;
  std::map<std::string, std::vector<float>> channels;
  std::map<std::string, float> attributes;  ///< float attributes only
};

/// Every channel as float. Throws Error Io, or what checkExrHeader (exr_header.h) throws before anything is decoded.
ExrImage readExr(const std::filesystem::path&, std::uint64_t maxPixels = std::uint64_t(1) << 28);

}  // namespace lmc
