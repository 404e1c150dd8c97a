#pragma once
/// Small levels made on the fly: a JSON text with a buffer of floats and indices beside it.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "libscene/level.h"

namespace lmc::test {

using Json = nlohmann::ordered_json;

/// A folder of the running test's own, gone with it.
class Folder {
 public:
  Folder() {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    path_ = std::filesystem::temp_directory_path() / ("lmc_" + std::string(info->test_suite_name()) + "_" + info->name());
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::filesystem::path write(const std::string& name, const std::string& bytes) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    std::ofstream(path_ / name, std::ios::binary) << bytes;
    return path_ / name;
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Appends values to a buffer and tells the view and accessor that show them.
struct Builder {
  Json json = {{"asset", {{"version", "2.0"}}}, {"scene", 0}, {"scenes", {{{"nodes", {0}}}}}, {"nodes", {{{"mesh", 0}}}}};
  std::string buffer;

  template <class T>
  int add(const std::vector<T>& values, const std::string& type, std::size_t components) {
    while (buffer.size() % 4 != 0) buffer += '\0';
    const int componentType = std::is_same_v<T, float>           ? 5126
                              : std::is_same_v<T, std::uint32_t> ? 5125
                              : std::is_same_v<T, std::uint16_t> ? 5123
                              : std::is_same_v<T, std::int8_t>   ? 5120
                                                                 : 5121;
    json["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", values.size() * sizeof(T)}});
    json["accessors"].push_back({{"bufferView", json["bufferViews"].size() - 1},
                                 {"componentType", componentType},
                                 {"count", values.size() / components},
                                 {"type", type}});
    buffer.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
    return int(json["accessors"].size()) - 1;
  }
  /// A mesh of one unit square in z = 0, facing +z, with both UV sets.
  void square() {
    const int positions = add<float>({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, "VEC3", 3);
    const int normals = add<float>({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3", 3);
    const int uvs = add<float>({0, 0, 1, 0, 1, 1, 0, 1}, "VEC2", 2);
    const int indices = add<std::uint16_t>({0, 1, 2, 0, 2, 3}, "SCALAR", 1);
    json["meshes"].push_back({{"primitives",
                               {{{"attributes", {{"POSITION", positions}, {"NORMAL", normals}, {"TEXCOORD_0", uvs}, {"TEXCOORD_1", uvs}}},
                                 {"indices", indices},
                                 {"material", 0}}}}});
    if (!json.contains("materials"))
      json["materials"] = {{{"pbrMetallicRoughness", {{"baseColorFactor", {0.5, 0.25, 0.125, 1}}, {"metallicFactor", 0}}}}};
  }
  std::filesystem::path save(const Folder& folder, const std::string& name = "level.gltf") {
    folder.write("level.bin", buffer);
    if (!buffer.empty()) json["buffers"] = {{{"byteLength", buffer.size()}, {"uri", "level.bin"}}};
    return folder.write(name, json.dump());
  }
};

inline Builder squareLevel() {
  Builder b;
  b.square();
  return b;
}

/// What a run had to say.
struct Heard {
  std::vector<Message> messages;
  Run run;
  Heard() {
    run.onMessage = [this](const Message& m) { messages.push_back(m); };
  }
  Heard(const Heard&) = delete;
  bool warned(const std::string& code) const { return has(Message::Level::Warning, code); }
  bool noted(const std::string& code) const { return has(Message::Level::Note, code); }
  std::size_t warnings() const {
    std::size_t n = 0;
    for (const Message& m : messages) n += m.level == Message::Level::Warning;
    return n;
  }

 private:
  bool has(Message::Level level, const std::string& code) const {
    for (const Message& m : messages)
      if (m.level == level && m.code == code) return true;
    return false;
  }
};

inline Scene load(const std::filesystem::path& level) { return loadLevel(level, {}, {}); }

/// The error that loading ends with.
inline Error errorOf(const std::filesystem::path& level, const LoadLimits& limits = {}) {
  try {
    loadLevel(level, limits, {});
  } catch (const Error& e) {
    return e;
  }
  ADD_FAILURE() << level << " was loaded";
  return Error(Exit::Done, level, "", "");
}

}  // namespace lmc::test
