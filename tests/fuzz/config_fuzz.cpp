/// extras.lmc of a scene, a node, a light and a material: the input is the text of one such object, given to all four.
#include "tests/fuzz/level_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const auto file = lmc::fuzz::ownFile(".gltf");
  const std::string config(reinterpret_cast<const char*>(data), size), extras = R"("extras":{"lmc":)" + config + "}";
  lmc::fuzz::put(file, R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1],)" + extras + R"(}],"nodes":[{"mesh":0,)" + extras +
                           R"(},{"extensions":{"KHR_lights_punctual":{"light":0}}}],"extensionsUsed":["KHR_lights_punctual"],)" +
                           R"("extensions":{"KHR_lights_punctual":{"lights":[{"type":"point",)" + extras + R"(}]}},"materials":[{)" +
                           extras + R"(}],"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,)" +
                           R"(AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}],"bufferViews":[{"buffer":0,"byteLength":36}],)" +
                           R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],)" +
                           R"("meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}]})");
  lmc::fuzz::load(file);
  return 0;
}
