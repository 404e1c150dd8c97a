/// Channels of an EXR file as raw little-endian floats on stdout, for tests in Python: "W H\n", then each named channel, rows from the top.
#include <cstdio>

#include "libscene/exr.h"

int main(int argc, char** argv) {
  if (argc < 3) return 1;
  const lmc::ExrImage image = lmc::readExr(argv[1]);
  std::printf("%d %d\n", image.width, image.height);
  for (int i = 2; i < argc; ++i) {
    const auto& data = image.channels.at(argv[i]);
    std::fwrite(data.data(), sizeof(float), data.size(), stdout);
  }
  return 0;
}
