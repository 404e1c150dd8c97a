/// Accessors and views over a buffer: offsets, counts, strides and types come from the input, and so do the bytes.
#include <cstring>
#include <nlohmann/json.hpp>

#include "tests/fuzz/level_file.h"

namespace {

using Json = nlohmann::ordered_json;

class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  std::uint8_t byte() { return at_ < size_ ? data_[at_++] : 0; }
  /// Mostly small, now and then as large as a number can be.
  std::int64_t number() {
    const std::uint8_t kind = byte();
    if (kind < 200) return kind % 64;
    std::int64_t out = 0;
    for (int k = 0; k < (kind < 250 ? 2 : 8); ++k) out = std::int64_t(std::uint64_t(out) << 8 | byte());
    return out;
  }
  std::string rest() {
    std::string out(reinterpret_cast<const char*>(data_) + at_, size_ - at_);
    at_ = size_;
    return out;
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_, at_ = 0;
};

std::string asGlb(const Json& json, std::string buffer) {
  std::string text = json.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  buffer.resize((buffer.size() + 3) / 4 * 4, '\0');
  std::string out;
  const auto put = [&](std::uint32_t v) { out.append(reinterpret_cast<const char*>(&v), 4); };
  put(0x46546c67);
  put(2);
  put(std::uint32_t(28 + text.size() + buffer.size()));
  put(std::uint32_t(text.size()));
  put(0x4e4f534a);
  out += text;
  put(std::uint32_t(buffer.size()));
  put(0x004e4942);
  return out + buffer;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const auto file = lmc::fuzz::ownFile(".glb");
  Input in(data, size);
  static constexpr int kTypes[] = {5120, 5121, 5122, 5123, 5125, 5126, 5126, 5126};
  static constexpr const char* kShapes[] = {"SCALAR", "VEC2", "VEC3", "VEC4", "VEC3", "MAT4", "VEC2", "VEC3"};
  Json json = {{"asset", {{"version", "2.0"}}}, {"scene", 0}, {"scenes", {{{"nodes", {0}}}}}, {"nodes", {{{"mesh", 0}}}}};
  for (int k = 0; k < 4; ++k) {
    Json view = {{"buffer", 0}, {"byteOffset", in.number()}, {"byteLength", in.number()}};
    if (in.byte() % 4 == 0) view["byteStride"] = in.number();
    json["bufferViews"].push_back(view);
    Json accessor = {{"bufferView", in.byte() % 4},
                     {"byteOffset", in.number()},
                     {"componentType", kTypes[in.byte() % 8]},
                     {"count", in.number()},
                     {"type", kShapes[in.byte() % 8]}};
    if (in.byte() % 4 == 0)
      accessor["sparse"] = {
          {"count", in.number()},
          {"indices", {{"bufferView", in.byte() % 4}, {"byteOffset", in.number()}, {"componentType", kTypes[in.byte() % 8]}}},
          {"values", {{"bufferView", in.byte() % 4}, {"byteOffset", in.number()}}}};
    if (in.byte() % 8 == 0) accessor["normalized"] = true;
    json["accessors"].push_back(accessor);
  }
  json["meshes"] = {
      {{"primitives", {{{"attributes", {{"POSITION", 0}, {"NORMAL", 1}, {"TEXCOORD_1", 2}}}, {"indices", 3}, {"mode", in.byte() % 7}}}}}};
  const std::string buffer = in.rest();
  json["buffers"] = {{{"byteLength", buffer.size()}}};
  lmc::fuzz::put(file, asGlb(json, buffer));
  lmc::fuzz::load(file);
  return 0;
}
