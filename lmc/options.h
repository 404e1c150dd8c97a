#pragma once
/// The command line as values. Every complaint is an Error Usage in words; --help is made from the same table.
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "libao/ao.h"
#include "libradiosity/partition.h"
#include "libscene/level.h"
#include "libscene/unwrap.h"

namespace lmc {

/// Ambient occlusion, of a bake and of a model.
struct AoOptions {
  ao::Options how;
  bool errorIsExplicit = false;  ///< then missing it is exit code 5
  bool bentInTangentSpace = false;
};

enum class ProgressKind { Auto, Bar, Lines, Json, None };
enum class Solver { Auto, Stored, Hierarchical, Dense, Shooting };
enum class Audit { Auto, On, Off };  ///< Auto: for goals below kAuditGoal

struct BakeOptions {
  std::filesystem::path level, out;
  double goal = 0.02;                         ///< relative RMS error asked for
  bool goalIsExplicit = false;                ///< then missing it is exit code 5
  std::string effects = "auto";               ///< auto, a LIST, or +x,-y
  int passes = 0;                             ///< bounces at most; 0 = until the light left is negligible
  double bounceTail = 0.0;                    ///< end the passes when what is unsent can add no more than this share; 0 = from the goal
  bool snapshot = false;                      ///< a map after each pass
  bool dumpPatches = false;                   ///< patches.obj and patches.png
  bool dumpSeams = false;                     ///< seams.png
  std::optional<std::array<int, 3>> explain;  ///< x, y and map of a texel whose light is told apart
  Solver solver = Solver::Auto;
  double patchSize_m = 0.0;  ///< 0 = from the goal and the level
  std::uint32_t maxPatches = 200000;
  bool interpolate = true;              ///< gather fewer texels where light is smooth
  std::uint32_t gatherRays = 0;         ///< hemisphere rays of each half of a gathered texel; 0 = from the goal
  Audit audit = Audit::Auto;            ///< check by unbiased path tracing
  int gatherRounds = 0;                 ///< rounds of hemisphere rays beyond the goal's
  bool resume = true;                   ///< keep finished tiles in the folder until the bake is done, and go on from those that are there
  double time_s = 0.0;                  ///< wall time to fill instead of a goal to reach; 0 = no such wish
  std::uint64_t maxLinks = 40'000'000;  ///< of the hierarchical solver
  PartitionOptions partition;           ///< of the hierarchical solver
  UvOptions uv;
  AoOptions ao;
  std::optional<Rgb> sky;  ///< replaces the level's; black = none
  std::uint64_t seed = 1;
  std::uint64_t memory_bytes = 0;  ///< limit; 0 = what the machine has. Never changes a result
  int threads = 0;
  bool json = false;
  std::filesystem::path depfile;
  ProgressKind progress = ProgressKind::Auto;
  LoadLimits limits;
};

struct PlanOptions {
  BakeOptions bake;
};

struct CompareOptions {
  std::filesystem::path a, b;
  std::optional<double> maxDiff;  ///< largest absolute difference allowed
  bool json = false;
};

struct ShadeOptions {
  std::filesystem::path out, picture;
  std::string camera;  ///< a camera's name, or px,py,pz,tx,ty,tz,fov
  int width = 1280, height = 720;
  double exposure = 0.0;       ///< factor on radiance; 0 = from the picture, 1 for an EXR file
  std::string view = "final";  ///< what is looked at
  bool reinhard = false;       ///< tone curve
  bool lightMap = true, bakedAo = true, screenAo = false, normalMaps = true, determinants = true;
  bool oracle = false;              ///< by C++, without GL
  std::filesystem::path shaderDir;  ///< own passes; empty = none
  int threads = 0;
};

struct CheckShaderOptions {
  std::filesystem::path shaderDir, level, picture = "shader-difference.png";
  std::string camera;
  int width = 320, height = 180;
  double maxDiff = 1.0 / 255.0;
  bool json = false;
  int threads = 0;
};

struct VerifyOptions {
  std::vector<std::filesystem::path> files;
  std::string only;  ///< cases whose id begins with it; empty = all
  bool json = false;
  std::uint64_t seed = 1;
  int threads = 0;
};

struct TangentOptions {
  bool regenerate = false;  ///< tangents of the file go, else they stay
  bool all = false;         ///< primitives whose material asks for none, too
  bool greenDown = false;   ///< for normal maps whose green points along V: determinants turned about
};

struct TangentsOptions {
  std::filesystem::path in, out;
  TangentOptions how;
  bool json = false;
  int threads = 0;
  LoadLimits limits;
};

struct NormalsOptions {
  enum class Source { Object, Tangent, Height, Picture, Model } source = Source::Height;
  std::filesystem::path map;   ///< the map, the heights, the picture or the model with more polygons
  std::filesystem::path mesh;  ///< the model that the map is for
  std::filesystem::path out;
  bool toObject = false;  ///< else tangent space
  bool greenDown = false;
  int bits = 8;
  int size = 1024;      ///< side of a map from a model [texels]
  double scale = 0.05;  ///< height of white above black, in widths of the picture
  bool repeat = true;
  int filter = 0;       ///< Derivative
  double cage_m = 0.0;  ///< 0 = a twentieth of the model's extent
  bool json = false;
  int threads = 0;
  LoadLimits limits;
};

struct AoJobOptions {
  std::filesystem::path model;
  std::filesystem::path out;  ///< .png or .exr: a map; .glb or .gltf: the model with the map, or with its vertices' openness
  std::string node;           ///< name of the node that is the model; empty = the whole file
  bool withLevel = false;     ///< the rest of the file blocks too
  AoOptions ao;
  bool uniform = false;  ///< in pictures and vertices, instead of the cosine weighting
  int size = 1024;       ///< side of a map [texels]
  int texCoord = 0;      ///< TEXCOORD_n of the map, 0 or 1
  bool perVertex = false;
  std::string attribute = "COLOR_0";
  std::uint64_t seed = 1;
  bool json = false;
  int threads = 0;
  LoadLimits limits;
};

struct UnwrapOptions {
  std::filesystem::path level, out;
  UvOptions uv;
  LoadLimits limits;
  bool json = false;
  int threads = 0;
};

struct InfoOptions {
  std::filesystem::path level, pictures;  ///< folder for pictures; empty = none
  UvOptions uv;
  LoadLimits limits;
  bool json = false;
  int threads = 0;
};

struct AttachOptions {
  std::filesystem::path level, baked;
  std::filesystem::path out;  ///< empty = attached.glb in the baked folder
  double tolerance = 1e-3;    ///< of the level's size: how far optimisers move surfaces
  LoadLimits limits;
  bool json = false;
  int threads = 0;
};

struct FitAttenuationOptions {
  double range_m = 0.0, near_m = 0.0;  ///< places of the fit lie between; near 0 = from the kind of fall-off
  std::string fallOff;                 ///< a kind's name, or a file of distances and values
  bool json = false;
};

/// What a study turns from rung to rung; the other options stay.
enum class Vary { Error, Ao, Patches, Rays, Passes };

struct StudyOptions {
  BakeOptions bake;  ///< `out` is the study's folder
  Vary vary = Vary::Error;
  std::vector<double> ladder;                ///< empty = the knob's own: errors, errors of openness, sizes [m], rays or passes
  std::filesystem::path reference;           ///< an EXR in lightmap.exr's (ao.exr's) layout; empty = none
  bool makeReference = false;                ///< by path tracing, kept in the folder
  double referenceError = 0.0;               ///< noise that one made may have; 0 = a third of the finest rung
  std::uint32_t referenceTexels = 1024;      ///< of one made
  std::uint64_t referenceRays = 2000000000;  ///< of one made, at most
};

struct ShowText {
  std::string text;  ///< help or version, for stdout
};

using Command =
    std::variant<BakeOptions, PlanOptions, CompareOptions, ShadeOptions, CheckShaderOptions, VerifyOptions, UnwrapOptions, InfoOptions,
                 AttachOptions, TangentsOptions, NormalsOptions, AoJobOptions, FitAttenuationOptions, StudyOptions, ShowText>;
Command parseCommandLine(int argc, const char* const* argv);

}  // namespace lmc
