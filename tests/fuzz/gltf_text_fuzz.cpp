/// glTF as text.
#include "tests/fuzz/level_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const auto file = lmc::fuzz::ownFile(".gltf");
  lmc::fuzz::put(file, {reinterpret_cast<const char*>(data), size});
  lmc::fuzz::load(file);
  return 0;
}
