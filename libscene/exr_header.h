#pragma once
/// The header of an EXR file, checked before OpenEXR sees a byte of it: OpenEXR 3.1 believes sizes that a damaged header states (a file of
/// 85 bytes took 7 GB), and its attributes of fixed size do not look at the size that the file gives them.
#include <cstdint>
#include <filesystem>
#include <vector>

namespace lmc {

/// Throws Error Broken (LMC_EXR: no header that makes sense), Limit (LMC_TEXTURE_TOO_LARGE: more pixels than `maxPixels`, or more than the
/// file can hold) or Unsupported (LMC_EXR_KIND: several parts, deep or subsampled channels). Attributes that are no business of lmc's are
/// made opaque in `bytes`, so that OpenEXR keeps them without a look.
void checkExrHeader(const std::filesystem::path& file, std::vector<std::uint8_t>& bytes, std::uint64_t maxPixels);

}  // namespace lmc
