/// Each row breaks one thing in a level that is good without it. (The corpus has the same, and more, as files.)
#include "libscene/gltf_check.h"

#include <gtest/gtest.h>

#include "tests/libscene/gltf_files.h"

namespace lmc::test {
namespace {

struct Fault {
  const char* name;
  const char* patch;  ///< RFC 7396 would not do for arrays: an RFC 6902 list
  Exit kind;
  const char* where;
  const char* code;
};

void PrintTo(const Fault& fault, std::ostream* out) { *out << fault.name; }

constexpr Fault kFaults[] = {
    {"NoAsset", R"([{"op":"remove","path":"/asset"}])", Exit::Broken, "", "LMC_VERSION"},
    {"VersionOne", R"([{"op":"add","path":"/asset/version","value":"1.0"}])", Exit::Unsupported, "/asset/version", "LMC_VERSION"},
    {"VersionIsAWord", R"([{"op":"add","path":"/asset/version","value":"two"}])", Exit::Broken, "/asset/version", "LMC_VERSION"},
    {"MinVersion", R"([{"op":"add","path":"/asset/minVersion","value":"2.1"}])", Exit::Unsupported, "/asset/minVersion", "LMC_VERSION"},
    {"RequiredUnknown",
     R"([{"op":"add","path":"/extensionsUsed","value":["A_b"]},{"op":"add","path":"/extensionsRequired","value":["A_b"]}])",
     Exit::Unsupported, "/extensionsRequired/0", "LMC_EXTENSION"},
    {"RequiredDraco", R"([{"op":"add","path":"/extensionsRequired","value":["KHR_draco_mesh_compression"]}])", Exit::Unsupported,
     "/extensionsRequired/0", "LMC_EXTENSION"},
    {"RequiredNotUsed", R"([{"op":"add","path":"/extensionsRequired","value":["KHR_materials_ior"]}])", Exit::Broken,
     "/extensionsRequired/0", "LMC_EXTENSION"},
    {"MeshesAnObject", R"([{"op":"add","path":"/meshes","value":{}}])", Exit::Broken, "/meshes", "LMC_JSON_SCHEMA"},
    {"IndexFraction", R"([{"op":"add","path":"/nodes/0/mesh","value":0.5}])", Exit::Broken, "/nodes/0/mesh", "LMC_REFERENCE"},
    {"IndexHuge", R"([{"op":"add","path":"/nodes/0/mesh","value":1e300}])", Exit::Broken, "/nodes/0/mesh", "LMC_REFERENCE"},
    {"IndexWraps", R"([{"op":"add","path":"/nodes/0/mesh","value":4294967296}])", Exit::Broken, "/nodes/0/mesh", "LMC_REFERENCE"},
    {"IndexNegative", R"([{"op":"add","path":"/nodes/0/mesh","value":-1}])", Exit::Broken, "/nodes/0/mesh", "LMC_REFERENCE"},
    {"SceneMissing", R"([{"op":"add","path":"/scene","value":1}])", Exit::Broken, "/scene", "LMC_REFERENCE"},
    {"NoRoot", R"([{"op":"add","path":"/nodes/1","value":{"children":[0]}}])", Exit::Broken, "/scenes/0/nodes/0", "LMC_NODE_PARENTS"},
    {"OwnChild", R"([{"op":"add","path":"/nodes/0/children","value":[0]}])", Exit::Broken, "/nodes/0", "LMC_NODE_CYCLE"},
    {"Cycle", R"([{"op":"add","path":"/nodes/1","value":{"children":[2]}},{"op":"add","path":"/nodes/2","value":{"children":[1]}}])",
     Exit::Broken, "/nodes/1", "LMC_NODE_CYCLE"},
    {"ChildTwice", R"([{"op":"add","path":"/nodes/1","value":{}},{"op":"add","path":"/nodes/0/children","value":[1,1]}])", Exit::Broken,
     "/nodes/1", "LMC_NODE_PARENTS"},
    {"Matrix15", R"([{"op":"add","path":"/nodes/0/matrix","value":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0]}])", Exit::Broken, "/nodes/0/matrix",
     "LMC_JSON_SCHEMA"},
    {"MatrixPerspective", R"([{"op":"add","path":"/nodes/0/matrix","value":[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1]}])", Exit::Broken,
     "/nodes/0/matrix", "LMC_MATRIX_BAD"},
    {"RotationZero", R"([{"op":"add","path":"/nodes/0/rotation","value":[0,0,0,0]}])", Exit::Broken, "/nodes/0/rotation", "LMC_ROTATION"},
    {"ViewPastBuffer", R"([{"op":"add","path":"/bufferViews/0/byteLength","value":4000}])", Exit::Broken, "/bufferViews/0",
     "LMC_BUFFER_VIEW"},
    {"ViewOffsetWraps", R"([{"op":"add","path":"/bufferViews/0/byteOffset","value":18446744073709551608}])", Exit::Broken,
     "/bufferViews/0/byteOffset", "LMC_BUFFER_VIEW"},
    {"StrideThree", R"([{"op":"add","path":"/bufferViews/0/byteStride","value":3}])", Exit::Broken, "/bufferViews/0/byteStride",
     "LMC_STRIDE"},
    {"StrideSmall", R"([{"op":"add","path":"/bufferViews/0/byteStride","value":8}])", Exit::Broken, "/accessors/0", "LMC_STRIDE"},
    {"CountPastView", R"([{"op":"add","path":"/accessors/0/count","value":5}])", Exit::Broken, "/accessors/0", "LMC_ACCESSOR_RANGE"},
    {"CountWraps", R"([{"op":"add","path":"/accessors/0/count","value":9223372036854775808}])", Exit::Broken, "/accessors/0",
     "LMC_ACCESSOR_RANGE"},
    {"CountZero", R"([{"op":"add","path":"/accessors/0/count","value":0}])", Exit::Broken, "/accessors/0/count", "LMC_JSON_SCHEMA"},
    {"ZerosBomb", R"([{"op":"remove","path":"/accessors/0/bufferView"},{"op":"add","path":"/accessors/0/count","value":1000000000}])",
     Exit::Broken, "/accessors/0", "LMC_MEMORY_LIMIT"},
    {"Unaligned", R"([{"op":"add","path":"/accessors/1/byteOffset","value":1},{"op":"add","path":"/accessors/1/count","value":3}])",
     Exit::Broken, "/accessors/1", "LMC_ALIGNMENT"},
    {"ComponentType", R"([{"op":"add","path":"/accessors/0/componentType","value":5124}])", Exit::Broken, "/accessors/0/componentType",
     "LMC_ACCESSOR_TYPE"},
    {"ElementType", R"([{"op":"add","path":"/accessors/0/type","value":"VEC5"}])", Exit::Broken, "/accessors/0/type", "LMC_ACCESSOR_TYPE"},
    {"PositionVec2", R"([{"op":"add","path":"/accessors/0/type","value":"VEC2"}])", Exit::Broken,
     "/meshes/0/primitives/0/attributes/POSITION", "LMC_ACCESSOR_TYPE"},
    {"AttributeCount", R"([{"op":"add","path":"/accessors/2/count","value":3}])", Exit::Broken,
     "/meshes/0/primitives/0/attributes/TEXCOORD_0", "LMC_ATTRIBUTE_COUNT"},
    {"Mode", R"([{"op":"add","path":"/meshes/0/primitives/0/mode","value":7}])", Exit::Broken, "/meshes/0/primitives/0/mode",
     "LMC_MODE_BAD"},
    {"BufferShort", R"([{"op":"add","path":"/buffers/0/byteLength","value":100000}])", Exit::Broken, "/buffers/0", "LMC_BUFFER_LENGTH"},
    {"AlbedoAboveOne", R"([{"op":"add","path":"/materials/0/pbrMetallicRoughness/baseColorFactor","value":[2,1,1,1]}])", Exit::Broken,
     "/materials/0/pbrMetallicRoughness/baseColorFactor/0", "LMC_ALBEDO_RANGE"},
    {"TextureMissing", R"([{"op":"add","path":"/materials/0/emissiveTexture","value":{"index":0}}])", Exit::Broken,
     "/materials/0/emissiveTexture/index", "LMC_REFERENCE"},
    {"ImageEscapes", R"([{"op":"add","path":"/images","value":[{"uri":"../a.png"}]}])", Exit::Broken, "/images/0/uri", "LMC_URI_ESCAPE"},
    {"ExtrasOfANode", R"([{"op":"add","path":"/nodes/0/extras","value":{"lmc":{"static":1}}}])", Exit::Broken, "/nodes/0/extras/lmc/static",
     "LMC_JSON_SCHEMA"},
    {"ExtrasOfAScene", R"([{"op":"add","path":"/scenes/0/extras","value":{"lmc":{"sky":{"radiance":[1,-1,0]}}}}])", Exit::Broken,
     "/scenes/0/extras/lmc/sky/radiance/1", "LMC_JSON_SCHEMA"},
};

class GltfCheck : public testing::TestWithParam<Fault> {};

TEST_P(GltfCheck, NamesThePlace) {
  const Fault& fault = GetParam();
  Folder folder;
  Builder b = squareLevel();
  b.save(folder);
  const Json broken = b.json.patch(Json::parse(fault.patch));
  const Error e = errorOf(folder.write("broken.gltf", broken.dump()));
  EXPECT_EQ(e.kind, fault.kind) << e.what();
  EXPECT_EQ(e.where, fault.where) << e.what();
  EXPECT_EQ(e.code, fault.code) << e.what();
}

INSTANTIATE_TEST_SUITE_P(Faults, GltfCheck, testing::ValuesIn(kFaults), [](const auto& fault) { return std::string(fault.param.name); });

struct LightFault {
  const char* light;
  const char* code;
};

TEST(GltfCheckLights, RefuseWhatNoLightCanBe) {
  for (const auto& [light, code] : {LightFault{R"({})", "LMC_LIGHT_TYPE"},
                                    {R"({"type":"sun"})", "LMC_LIGHT_TYPE"},
                                    {R"({"type":"point","intensity":-1})", "LMC_LIGHT_INTENSITY"},
                                    {R"({"type":"point","intensity":"bright"})", "LMC_LIGHT_INTENSITY"},
                                    {R"({"type":"point","color":[1,1]})", "LMC_LIGHT_COLOR"},
                                    {R"({"type":"point","range":0})", "LMC_LIGHT_RANGE"},
                                    {R"({"type":"point","range":-1})", "LMC_LIGHT_RANGE"},
                                    {R"({"type":"spot"})", "LMC_SPOT_ANGLES"},
                                    {R"({"type":"spot","spot":{"innerConeAngle":0.5,"outerConeAngle":0.4}})", "LMC_SPOT_ANGLES"},
                                    {R"({"type":"spot","spot":{"outerConeAngle":2}})", "LMC_SPOT_ANGLES"}}) {
    Folder folder;
    Builder b = squareLevel();
    b.json["extensionsUsed"] = {"KHR_lights_punctual"};
    b.json["extensions"]["KHR_lights_punctual"]["lights"] = {Json::parse(light)};
    const Error e = errorOf(b.save(folder));
    EXPECT_EQ(e.kind, Exit::Broken) << light;
    EXPECT_EQ(e.code, code) << light;
    EXPECT_TRUE(e.where.starts_with("/extensions/KHR_lights_punctual/lights/0")) << e.where;
  }
}

TEST(JsonText, DepthIsJudgedBeforeItIsParsed) {
  EXPECT_THROW(checkJsonText(std::string(100000, '['), 64, "a.gltf"), Error);
  EXPECT_NO_THROW(checkJsonText(std::string(64, '['), 64, "a.gltf"));
  EXPECT_NO_THROW(checkJsonText(R"({"a": "[[[[[[[[\"[[[[["})", 3, "a.gltf"));
}

TEST(JsonText, AMemberThatStandsTwiceIsFound) {
  EXPECT_EQ(checkJsonText(R"({"a":1,"b":{"a":2},"c":["a","a"]})", 64, "a.gltf"), "");
  EXPECT_EQ(checkJsonText(R"({"a":1,"b":{"c":2,"d":3,"c":4}})", 64, "a.gltf"), "c");
}

TEST(JsonText, OnlyJsonIsTaken) {
  Folder folder;
  for (const char* text :
       {"", "{", "[]", R"({"asset":{"version":"2.0"},})", R"({"asset":{"version":"2.0"}} x)", R"({"asset":{"version":"2.0"},"a":NaN})",
        R"({"asset":{"version":"2.0"},"a":1e999})", "{/*c*/}", "{\"a\":\"\xff\"}"})
    EXPECT_EQ(errorOf(folder.write("a.gltf", text)).code, "LMC_JSON") << text;
}

TEST(Base64, IsStrict) {
  std::vector<std::uint8_t> bytes;
  ASSERT_TRUE(decodeBase64("AAEC/w==", bytes));
  EXPECT_EQ(bytes, (std::vector<std::uint8_t>{0, 1, 2, 255}));
  EXPECT_FALSE(decodeBase64("AAEC/", bytes));
  EXPECT_FALSE(decodeBase64("AA!C", bytes));
  EXPECT_FALSE(decodeBase64("AA==AAAA", bytes));
}

}  // namespace
}  // namespace lmc::test
