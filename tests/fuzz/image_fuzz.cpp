/// PNG, JPEG and EXR, told by their first bytes.
#include "libscene/exr.h"
#include "libscene/image_file.h"
#include "tests/fuzz/level_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::uint64_t kPixels = 1 << 18;
  if (size > 0 && data[0] == 0x76) {
    static const auto file = lmc::fuzz::ownFile(".exr");
    lmc::fuzz::put(file, {reinterpret_cast<const char*>(data), size});
    try {
      lmc::readExr(file, kPixels);
    } catch (const lmc::Error&) {
    }
    return 0;
  }
  lmc::decodeImage({data, size}, kPixels);
  lmc::decodeDeepImage({data, size}, kPixels);
  return 0;
}
