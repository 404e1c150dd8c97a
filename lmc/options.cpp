#include "lmc/options.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>

#include "lmc/help.h"
#include "lmc/option_values.h"

namespace lmc {

namespace {

const std::map<std::string, ProgressKind> kProgress{{"auto", ProgressKind::Auto},
                                                    {"bar", ProgressKind::Bar},
                                                    {"lines", ProgressKind::Lines},
                                                    {"json", ProgressKind::Json},
                                                    {"none", ProgressKind::None}};
const std::map<std::string, double> kPresets{{"draft", 0.08}, {"level", 0.02}, {"final", 0.01}};
const std::map<std::string, Solver> kSolvers{{"auto", Solver::Auto},
                                             {"stored", Solver::Stored},
                                             {"hierarchical", Solver::Hierarchical},
                                             {"dense", Solver::Dense},
                                             {"shooting", Solver::Shooting}};

const std::map<std::string, UvMode> kUvModes{{"keep", UvMode::Keep}, {"repair", UvMode::Repair}, {"new", UvMode::New}};

void addUvOptions(CLI::App* app, UvOptions& o) {
  app->add_option_function<std::string>(
         "--uv", [&o](const std::string& t) { o.mode = kUvModes.at(t); },
         "keep (TEXCOORD_1 as it is; faults are errors), repair (keep what is sound, place or make anew what is not; the default) or new "
         "(make all)")
      ->check(CLI::IsMember({"keep", "repair", "new"}))
      ->type_name("MODE");
  app->add_option(
         "--map-size", o.mapSize,
         "side of a light map in texels [default: the level's lightmap.resolution, else from the density]; new UVs fill one map of "
         "it unless a density is given")
      ->check(CLI::Range(4, 16384));
  app->add_option("--texels-per-metre", o.texelsPerMetre,
                  "density when no size is given, and of new UVs [default: the level's, else 16 and a map of at least 256 x 256]")
      ->check(CLI::Range(1e-6, 1e6));
  app->add_option("--padding", o.padding,
                  "texels between borders of charts of new UVs; 2 keep bilinear look-ups apart, 4 one mip level more")
      ->capture_default_str()
      ->check(CLI::Range(0, 64));
  app->add_option("--max-maps", o.maxMaps, "light maps at most, for new UVs; exit code 8 where charts do not fit")
      ->capture_default_str()
      ->check(CLI::Range(1, 1024));
}

const std::map<std::string, ao::FallOff> kFallOffs{
    {"none", ao::FallOff::None}, {"linear", ao::FallOff::Linear}, {"quadratic", ao::FallOff::Quadratic}};

void addAoOptions(CLI::App* app, AoOptions& o) {
  app->add_option_function<std::string>(
         "--ao-error",
         [&o](const std::string& t) {
           o.how.error = shareOf(t, "--ao-error");
           o.errorIsExplicit = true;
         },
         "RMS error of ambient occlusion asked for, such as 0.01 (the default) or 1%; exit code 5 when it is missed")
      ->type_name("ERROR");
  app->add_option("--ao-distance", o.how.distance_m, "occluders farther than this do not count [m; default: all count]")
      ->check(CLI::Range(1e-9, 1e9));
  app->add_option_function<std::string>(
         "--ao-falloff", [&o](const std::string& t) { o.how.fallOff = kFallOffs.at(t); },
         "how much nearer ones count at t of the distance: none (1; the default), linear (1 - t) or quadratic ((1 - t)^2)")
      ->check(CLI::IsMember({"none", "linear", "quadratic"}))
      ->type_name("KIND");
}

void checkAo(const AoOptions& o) {
  if (o.how.fallOff != ao::FallOff::None && !std::isfinite(o.how.distance_m))
    throw Error(Exit::Usage, "lmc", "", "--ao-falloff needs --ao-distance: nothing falls off over an endless way");
}

/// --bent asks for the effect, too.
void askForBent(BakeOptions& o, bool asked) {
  if (!asked) return;
  const bool changes = o.effects == "auto" || o.effects.starts_with('+') || o.effects.starts_with('-');
  o.effects = (o.effects == "auto" ? std::string() : o.effects + ",") + (changes ? "+bent" : "bent");
}

constexpr const char* kInputLimits = "Limits on what is read (a level above one is refused: exit code 3)";
constexpr const char* kBakeLimits = "Limits on the bake";

void addInputLimits(CLI::App* app, LoadLimits& o) {
  app->add_option("--max-input-bytes", o.maxInputBytes, "bytes of all files of a level together")
      ->capture_default_str()
      ->group(kInputLimits);
  app->add_option("--max-texture-pixels", o.maxTexturePixels, "texels of one picture, judged by its header")
      ->capture_default_str()
      ->group(kInputLimits);
  app->add_option("--max-triangles", o.maxTriangles, "triangles of a level, those of every instance counted")
      ->capture_default_str()
      ->group(kInputLimits);
  app->add_option("--max-nodes", o.maxNodes, "nodes of a level")->capture_default_str()->group(kInputLimits);
  app->add_option("--max-instances", o.maxInstances, "instances of meshes, EXT_mesh_gpu_instancing included")
      ->capture_default_str()
      ->group(kInputLimits);
  app->add_option("--max-json-depth", o.maxJsonDepth, "nesting of a level's JSON")
      ->capture_default_str()
      ->check(CLI::Range(1, 512))
      ->group(kInputLimits);
  app->add_option("--max-extent", o.maxExtent_m, "distance of a vertex or a light from the origin [m]")
      ->capture_default_str()
      ->check(CLI::Range(1e-9, 1e15))
      ->group(kInputLimits);
}

void addLevelOptions(CLI::App* app, BakeOptions& o) {
  app->add_option("LEVEL", o.level, "level to read, .glb or .gltf")->required();
  app->add_option_function<std::string>(
         "--max-error",
         [&o](const std::string& t) {
           o.goal = shareOf(t, "--max-error");
           o.goalIsExplicit = true;
         },
         "relative RMS error asked for, such as 2%; exit code 5 when it is missed")
      ->type_name("ERROR");
  app->add_option_function<std::string>(
         "--preset",
         [&o, app](const std::string& t) {
           if (app->count("--max-error") == 0) o.goal = kPresets.at(t);
         },
         "draft (8 %), level (2 %, the default), final (1 %)")
      ->check(CLI::IsMember({"draft", "level", "final"}))
      ->type_name("NAME");
  app->add_option("--effects", o.effects,
                  "auto, exactly these (direct,shadow,area,sky,bounce,ao,bent,tangents,seams,rims), or changes to auto (+sky,+rims,"
                  "-bounce,-near,-colour,-alpha); lmc plan tells of each")
      ->type_name("LIST");
  app->add_option_function<std::string>(
         "--passes", [&o](const std::string& t) { o.passes = passesOf(t); }, "bounces: auto (until what is left is negligible) or a number")
      ->type_name("N");
  app->add_option_function<std::string>(
         "--bounce-tail", [&o](const std::string& t) { o.bounceTail = shareOf(t, "--bounce-tail"); },
         "end the passes when the light still to be sent can add no more than this share [default: a twentieth of the error asked for]")
      ->type_name("SHARE");
  addUvOptions(app, o.uv);
  app->add_option_function<std::string>(
         "--sky", [&o](const std::string& t) { o.sky = skyOf(t); }, "none, scene (default) or a constant radiance R,G,B [cd/m^2]")
      ->type_name("SKY");
  app->add_option_function<std::string>(
         "--solver", [&o](const std::string& t) { o.solver = kSolvers.at(t); },
         "auto, stored (rays kept, any level), hierarchical (links between clusters), dense (the reference, up to 4096 patches) or "
         "shooting (pass by pass)")
      ->check(CLI::IsMember({"auto", "stored", "hierarchical", "dense", "shooting"}))
      ->type_name("NAME");
  app->add_option("--patch-size", o.patchSize_m,
                  "side of all radiosity patches in metres [default: from goal and level, smaller where light changes]")
      ->check(CLI::Range(1e-9, 1e9));
  app->add_option("--max-patches", o.maxPatches, "patches at most; above it they grow")
      ->capture_default_str()
      ->check(CLI::Range(16, 10000000))
      ->group(kBakeLimits);
  app->add_option_function<std::string>(
         "--gather", [&o](const std::string& t) { o.interpolate = t == "auto"; },
         "auto (few texels where light is smooth, what lies between interpolated) or full (every texel)")
      ->check(CLI::IsMember({"auto", "full"}))
      ->type_name("KIND");
  app->add_option("--max-links", o.maxLinks, "links at most, --solver hierarchical; above it they get coarser")
      ->capture_default_str()
      ->check(CLI::Range(std::uint64_t(1), std::uint64_t(1) << 40))
      ->group(kBakeLimits);
  app->add_option_function<std::string>(
         "--partition", [&o](const std::string& t) { o.partition = partitionOf(t); },
         "what pairs of clusters are told without a ray, --solver hierarchical: auto, all, none or a list of "
         "facing,cells,empty,blocked")
      ->type_name("LIST");
  app->add_option("--gather-rays", o.gatherRays,
                  "hemisphere rays of each half of a gathered texel, whatever the goal [default: as many as the goal asks for]")
      ->check(CLI::Range(1, 16384));
  app->add_option("--gather-rounds", o.gatherRounds, "rounds of hemisphere rays beyond the goal's, as a run with --time states them")
      ->check(CLI::Range(0, 200));
  app->add_flag_callback(
      "--audit", [&o] { o.audit = Audit::On; },
      "check the stated error by unbiased path tracing, at most a quarter of the rays [default: for goals below 2 %]");
  app->add_flag_callback(
      "--no-audit", [&o] { o.audit = Audit::Off; }, "do not check it so");
  addAoOptions(app, o.ao);
  app->add_option_function<std::string>(
         "--bent", [&o](const std::string& t) { o.ao.bentInTangentSpace = t == "tangent"; },
         "bent normals too, in world space or in the tangent space of TEXCOORD_0")
      ->check(CLI::IsMember({"world", "tangent"}))
      ->type_name("SPACE");
  app->add_option("--seed", o.seed, "of all random numbers")->capture_default_str();
  app->add_option("-j,--threads", o.threads, "threads [default: all]; never changes a result")->check(CLI::Range(1, 1024));
  addInputLimits(app, o.limits);
}

void addGreen(CLI::App* app, bool& down) {
  app->add_option_function<std::string>(
         "--green", [&down](const std::string& t) { down = t == "down"; }, "where green of a normal map points: up (glTF) or down (V)")
      ->check(CLI::IsMember({"up", "down"}))
      ->type_name("WAY")
      ->default_str("up");
}

void addNormals(CLI::App* app, NormalsOptions& o, std::string& from, std::string& as) {
  app->add_option("--from", from, "object or tangent (the space of --map), a model with more polygons (.glb, .gltf), or a picture")
      ->required()
      ->type_name("SOURCE");
  app->add_option("--to", "space of what is written: tangent (default) or object")
      ->each([&o](const std::string& t) { o.toObject = t == "object"; })
      ->check(CLI::IsMember({"tangent", "object"}))
      ->type_name("SPACE");
  app->add_option("--map", o.map, "normal map to convert, PNG or JPEG")->type_name("FILE");
  app->add_option("--mesh", o.mesh, "model that the map is for; its nodes' transforms are applied, TEXCOORD_0 is used")->type_name("FILE");
  app->add_option("-o,--out", o.out, "PNG file to write")->required();
  app->add_option("--as", as, "what a picture is: height (its first channel, default) or diffuse (its luminance is the height)")
      ->check(CLI::IsMember({"height", "diffuse"}))
      ->type_name("KIND");
  app->add_option("--scale", o.scale, "height of white above black, in widths of the picture")
      ->capture_default_str()
      ->check(CLI::Range(-1e6, 1e6));
  app->add_option_function<std::string>(
         "--wrap", [&o](const std::string& t) { o.repeat = t == "repeat"; }, "at the borders: repeat (default) or clamp")
      ->check(CLI::IsMember({"repeat", "clamp"}))
      ->type_name("KIND");
  app->add_option("--filter", "derivative: central (default), sobel or scharr")
      ->each([&o](const std::string& t) { o.filter = t == "central" ? 0
                                                     : t == "sobel" ? 1
                                                                    : 2; })
      ->check(CLI::IsMember({"central", "sobel", "scharr"}))
      ->type_name("KIND");
  app->add_option("--cage", o.cage_m,
                  "how far above and below the model its polygons are looked for [m; default: a twentieth of its extent]")
      ->check(CLI::Range(1e-9, 1e9));
  app->add_option("--size", o.size, "side of a map from a model [texels]")->capture_default_str()->check(CLI::Range(1, 16384));
  app->add_option("--bits", o.bits, "of a channel")->capture_default_str()->check(CLI::IsMember({8, 16}));
  addGreen(app, o.greenDown);
  app->add_flag("--json", o.json, "print the report as JSON");
  app->add_option("-j,--threads", o.threads, "threads [default: all]; never changes a result")->check(CLI::Range(1, 1024));
  addInputLimits(app, o.limits);
}

/// What --from and --as mean.
NormalsOptions settled(NormalsOptions o, const std::string& from, const std::string& as) {
  using Source = NormalsOptions::Source;
  const bool map = from == "object" || from == "tangent";
  const std::filesystem::path file = from;
  if (map != !o.map.empty())
    throw Error(Exit::Usage, "lmc", "", "normals: --map belongs to --from object and --from tangent, and only to them");
  if (map)
    o.source = from == "object" ? Source::Object : Source::Tangent;
  else
    o.source = file.extension() == ".glb" || file.extension() == ".gltf" ? Source::Model
               : as == "diffuse"                                         ? Source::Picture
                                                                         : Source::Height;
  if (!map) o.map = file;
  if ((o.source == Source::Model || o.toObject != (o.source == Source::Object)) && o.mesh.empty() &&
      (o.source == Source::Model || map || o.toObject))
    throw Error(Exit::Usage, "lmc", "", "normals: this needs the model that the map is for: --mesh FILE.glb");
  return o;
}

const char* const kCameraHelp =
    "name of a camera of the level, or px,py,pz,tx,ty,tz,fov (metres, degrees) [default: the level's first, else one made]";

void addShade(CLI::App* app, ShadeOptions& o) {
  app->add_option("OUT", o.out, "folder of a bake, or a level that was not baked")->required();
  app->add_option("-o,--out", o.picture, "file to write: .png, or .exr (linear, exposure 1)")->required();
  app->add_option("--camera", o.camera, kCameraHelp)->type_name("CAMERA");
  app->add_option("--width", o.width, "pixels")->capture_default_str()->check(CLI::Range(1, 16384));
  app->add_option("--height", o.height, "pixels")->capture_default_str()->check(CLI::Range(1, 16384));
  app->add_option("--exposure", o.exposure, "factor on outgoing radiance [default: from the picture]")->check(CLI::Range(1e-12, 1e12));
  app->add_option("--view", o.view, "what is looked at: the picture, a target of the G-buffer, or light alone")
      ->capture_default_str()
      ->check(CLI::IsMember({"final", "radiance", "diffuse", "ao", "specular", "power", "normal", "depth", "lightmap", "emission",
                             "screen-ao", "ambient", "diffuse-light", "specular-light"}))
      ->type_name("VIEW");
  app->add_option_function<std::string>(
         "--tonemap", [&o](const std::string& t) { o.reinhard = t == "reinhard"; },
         "none (cut off at white; the default) or reinhard (c/(1 + c))")
      ->check(CLI::IsMember({"none", "reinhard"}))
      ->type_name("CURVE");
  app->add_option_function<std::string>(
         "--ao",
         [&o](const std::string& t) {
           o.bakedAo = t == "baked" || t == "both";
           o.screenAo = t == "screen" || t == "both";
         },
         "ambient occlusion: baked (of the map or the material; the default), screen (screen space), both or off")
      ->check(CLI::IsMember({"baked", "screen", "both", "off"}))
      ->type_name("KIND");
  app->add_flag_callback(
      "--no-light-map", [&o] { o.lightMap = false; }, "as if the level were not baked: all lights drawn by the passes");
  app->add_flag_callback(
      "--no-normal-maps", [&o] { o.normalMaps = false; }, "vertex normals alone");
  app->add_flag_callback(
      "--ignore-determinant", [&o] { o.determinants = false; }, "take all UVs for unmirrored, for a look at what that does");
  app->add_flag("--oracle", o.oracle, "draw in C++ and double precision, without GL");
  app->add_option("--shader-dir", o.shaderDir, "folder of own shaders: each takes the place of lmc's of the same name")->type_name("DIR");
  app->add_option("-j,--threads", o.threads, "threads of --oracle [default: all]; never changes a result")->check(CLI::Range(1, 1024));
}

void addCheckShader(CLI::App* app, CheckShaderOptions& o) {
  app->add_option("OUT", o.level, "folder of a bake, or a level that was not baked")->required();
  app->add_option("--shader-dir", o.shaderDir, "folder of own shaders: each takes the place of lmc's of the same name")
      ->required()
      ->type_name("DIR");
  app->add_option("-o,--out", o.picture, "PNG to write where pictures differ: reference, own, difference")->capture_default_str();
  app->add_option("--camera", o.camera, kCameraHelp)->type_name("CAMERA");
  app->add_option("--width", o.width, "pixels")->capture_default_str()->check(CLI::Range(1, 16384));
  app->add_option("--height", o.height, "pixels")->capture_default_str()->check(CLI::Range(1, 16384));
  app->add_option("--max-diff", o.maxDiff,
                  "largest difference allowed, of the largest value of a target; exit code 7 above it [default: 1/255]")
      ->check(CLI::Range(0.0, 1e12));
  app->add_flag("--json", o.json, "print the figures as JSON");
  app->add_option("-j,--threads", o.threads, "threads [default: all]; never changes a result")->check(CLI::Range(1, 1024));
}

void addAo(CLI::App* app, AoJobOptions& o) {
  app->add_option("MODEL", o.model, "file to read, .glb or .gltf")->required();
  app->add_option(
         "-o,--out", o.out,
         "file to write: .png (8 bit, linear) or .exr is the map; .glb or .gltf is the model, with the map as its occlusionTexture, or "
         "with --per-vertex")
      ->required();
  app->add_option("--node", o.node, "name of the node that is the model, with what hangs on it [default: the whole file]");
  app->add_flag("--with-level", o.withLevel, "what else is in the file blocks, too; else only the model does");
  addAoOptions(app, o.ao);
  app->add_option("--weighting", "of pictures and vertices: cosine (default) or uniform (share of rays); an .exr has both")
      ->each([&o](const std::string& t) { o.uniform = t == "uniform"; })
      ->check(CLI::IsMember({"cosine", "uniform"}))
      ->type_name("KIND");
  app->add_option("--bent", "bent normals too (.exr only), in world or tangent space")
      ->each([&o](const std::string& t) {
        o.ao.how.bent = true;
        o.ao.bentInTangentSpace = t == "tangent";
      })
      ->check(CLI::IsMember({"world", "tangent"}))
      ->type_name("SPACE");
  app->add_option("--size", o.size, "side of the map [texels]")->capture_default_str()->check(CLI::Range(4, 16384));
  app->add_option("--texcoord", o.texCoord, "TEXCOORD_n that the map lies on, 0 or 1")->capture_default_str()->check(CLI::Range(0, 1));
  app->add_flag("--per-vertex", o.perVertex, "a value a vertex instead of a map");
  app->add_option("--attribute", o.attribute, "attribute for --per-vertex: COLOR_0 (times what is there), or one of your own such as _AO")
      ->capture_default_str();
  app->add_option("--seed", o.seed, "of all random numbers")->capture_default_str();
  app->add_flag("--json", o.json, "print the report as JSON");
  app->add_option("-j,--threads", o.threads, "threads [default: all]; never changes a result")->check(CLI::Range(1, 1024));
  addInputLimits(app, o.limits);
}

AoJobOptions settled(AoJobOptions o) {
  checkAo(o.ao);
  const std::string kind = o.out.extension().string();
  const bool picture = kind == ".png" || kind == ".exr", model = kind == ".glb" || kind == ".gltf";
  const auto refuse = [](std::string_view what) { throw Error(Exit::Usage, "lmc", "", fmt::format("ao: {}", what)); };
  if (!picture && !model) refuse("-o: the name must end in .png, .exr, .glb or .gltf");
  if (o.perVertex && picture) refuse("--per-vertex writes a model: -o FILE.glb");
  if (o.ao.how.bent && kind != ".exr") refuse("--bent writes to an .exr alone");
  if (o.perVertex && o.attribute != "COLOR_0" && !o.attribute.starts_with('_'))
    refuse("--attribute is COLOR_0 or a name that begins with _");
  if (o.withLevel && o.node.empty()) refuse("--with-level needs --node: without it the whole file is the model");
  return o;
}

const std::map<std::string, Vary> kKnobs{
    {"error", Vary::Error}, {"ao", Vary::Ao}, {"patches", Vary::Patches}, {"rays", Vary::Rays}, {"passes", Vary::Passes}};

void addStudy(CLI::App* app, StudyOptions& o, std::string& ladder) {
  addLevelOptions(app, o.bake);
  app->add_option("-o,--out", o.bake.out, "folder for the study; one that is there is gone on with")->required();
  app->add_option_function<std::string>(
         "--vary", [&o](const std::string& t) { o.vary = kKnobs.at(t); },
         "what differs from rung to rung: error (the default), ao (--ao-error), patches (--patch-size), rays (--gather-rays) or passes "
         "(--passes); the rest stays as it is said")
      ->check(CLI::IsMember({"error", "ao", "patches", "rays", "passes"}))
      ->type_name("KNOB");
  app->add_option(
         "--ladder", ladder,
         "rungs, coarse to fine: errors such as 8,4,2,1,0.5 (percent; the default), errors of openness in percent, metres, rays, passes")
      ->type_name("LIST");
  app->add_option("--reference", o.reference,
                  "the truth, an EXR laid out as lightmap.exr (texels with A = 0 are not compared), or as ao.exr")
      ->type_name("FILE");
  app->add_flag("--make-reference", o.makeReference, "make one by unbiased path tracing of some texels; it is kept in the folder");
  app->add_option_function<std::string>(
         "--reference-error", [&o](const std::string& t) { o.referenceError = shareOf(t, "--reference-error"); },
         "noise that it may have [default: a third of the finest rung, at most 1 %]")
      ->type_name("ERROR");
  app->add_option("--reference-texels", o.referenceTexels, "texels that are drawn for it")
      ->capture_default_str()
      ->check(CLI::Range(16, 1000000));
  app->add_option("--reference-rays", o.referenceRays, "rays that it may take, about")
      ->capture_default_str()
      ->check(CLI::Range(std::uint64_t(1000), std::uint64_t(1) << 50));
  app->add_flag("--json", o.bake.json, "print the table as JSON");
}

StudyOptions settled(StudyOptions o, const std::string& ladder) {
  const bool shares = o.vary == Vary::Error || o.vary == Vary::Ao, counts = o.vary == Vary::Rays || o.vary == Vary::Passes;
  o.ladder = ladderOf(ladder, shares, counts);
  if (!o.reference.empty() && o.makeReference) throw Error(Exit::Usage, "lmc", "", "--reference or --make-reference, not both");
  if (o.vary == Vary::Ao && o.makeReference && std::isfinite(o.bake.ao.how.distance_m))
    throw Error(Exit::Usage, "lmc", "", "--make-reference of openness knows no --ao-distance");
  if (o.vary == Vary::Passes && o.bake.solver != Solver::Auto && o.bake.solver != Solver::Shooting)
    throw Error(Exit::Usage, "lmc", "", "only --solver shooting has passes");
  checkAo(o.bake.ao);
  return o;
}

void addBake(CLI::App* app, BakeOptions& o) {
  addLevelOptions(app, o);
  app->footer(kFixedLimits + std::string("\n") + kExitCodes);
  app->add_option("-o,--out", o.out, "folder for the outputs; made when missing")->required()->type_name("FOLDER");
  app->add_flag("--snapshot", o.snapshot, "also write passes/pass.NNN.exr, the map from patches alone, after each pass of the solver");
  app->add_option_function<std::vector<std::string>>(
         "--dump",
         [&o](const std::vector<std::string>& what) {
           for (const std::string& w : what) (w == "seams" ? o.dumpSeams : o.dumpPatches) = true;
         },
         "also write what was made on the way, a list: patches (patches.obj, patches.png: patches in the map's layout, the finer the "
         "brighter), seams (seams.png: differences across smooth seams before and after they were closed)")
      ->delimiter(',')
      ->check(CLI::IsMember({"patches", "seams"}))
      ->type_name("WHAT");
  app->add_option_function<std::string>(
         "--memory", [&o](const std::string& t) { o.memory_bytes = memoryOf(t); },
         "what the process may hold, within 10 %, such as 512M or 2G [default: 960M, or 256M beside a level that takes more]: what lmc "
         "keeps a texel then lies in files in OUT; never changes a result; exit code 8, before the work, where less than the least")
      ->type_name("SIZE")
      ->group(kBakeLimits);
  app->add_option_function<std::string>(
         "--explain", [&o](const std::string& t) { o.explain = texelOf(t); },
         "also say which lights, surfaces and sky made a texel, and what stands in their way (row 0 is the top)")
      ->type_name("X,Y[,MAP]");
  app->add_option_function<std::string>(
         "--time", [&o](const std::string& t) { o.time_s = secondsOf(t); },
         "the best map in this time, such as 90s or 2m, instead of an error asked for; the error reached is stated, and the goal and "
         "rounds that "
         "give the same bytes; exit code 5 where it cannot be done in that time")
      ->type_name("TIME");
  app->add_flag_callback(
      "--no-resume", [&o] { o.resume = false; },
      "start from zero and keep no journal [default: finished tiles are kept in OUT/.lmc-resume until the bake is done, and "
      "the same command goes on with those of a run that was stopped or killed; not with --time]");
  app->add_flag("--json", o.json, "print the report on stdout");
  app->add_option("--depfile", o.depfile, "write the level's input files as a Make rule for the sidecar")->type_name("FILE");
  app->add_option_function<std::string>(
         "--progress", [&o](const std::string& t) { o.progress = kProgress.at(t); },
         "auto (bar on a terminal, else lines), bar, lines, json, none")
      ->check(CLI::IsMember({"auto", "bar", "lines", "json", "none"}))
      ->type_name("KIND");
}

void addPlan(CLI::App* app, PlanOptions& o) {
  addLevelOptions(app, o.bake);
  app->add_flag("--json", o.bake.json, "print the plan as JSON");
}

void addCompare(CLI::App* app, CompareOptions& o) {
  app->add_option("A", o.a, "first file")->required();
  app->add_option("B", o.b, "second file")->required();
  app->add_option("--max-diff", o.maxDiff, "largest absolute difference allowed; exit code 7 above it")->type_name("X");
  app->add_flag("--json", o.json, "print the figures as JSON");
}

void addVerify(CLI::App* app, VerifyOptions& o) {
  app->add_option("CASES", o.files, "files of cases (JSON, schema lmc-analytic/1) or of tangent vectors (.tspace)")->required();
  app->add_option("--only", o.only, "run the case of this id, or all whose id begins so")->type_name("ID");
  app->add_flag("--json", o.json, "print the results as JSON");
  app->add_option("--seed", o.seed, "of all random numbers")->capture_default_str();
  app->add_option("-j,--threads", o.threads, "threads [default: all]")->check(CLI::Range(1, 1024));
}

void addTangents(CLI::App* app, TangentsOptions& o) {
  app->add_option("IN", o.in, "file to read, .glb or .gltf")->required();
  app->add_option("-o,--out", o.out, "file to write: .glb, or .gltf with its buffer inside")->required();
  app->add_flag("--regenerate", o.how.regenerate, "make those anew that the file has; else they are checked and kept");
  app->add_flag("--all", o.how.all, "also where no normal map calls for them, by TEXCOORD_0");
  addGreen(app, o.how.greenDown);
  addInputLimits(app, o.limits);
  app->add_flag("--json", o.json, "print the report as JSON");
  app->add_option("-j,--threads", o.threads, "threads [default: all]; never changes a result")->check(CLI::Range(1, 1024));
}

void addUnwrap(CLI::App* app, UnwrapOptions& o) {
  app->add_option("LEVEL", o.level, "level to read, .glb or .gltf")->required();
  app->add_option("-o,--out", o.out, "file to write: .glb, or .gltf with its buffer inside")->required();
  addUvOptions(app, o.uv);
  addInputLimits(app, o.limits);
  app->add_flag("--json", o.json, "print what was done as JSON");
  app->add_option("-j,--threads", o.threads, "threads [default: all]; never changes a result")->check(CLI::Range(1, 1024));
}

void addInfo(CLI::App* app, InfoOptions& o) {
  app->add_option("LEVEL", o.level, "level to read, .glb or .gltf")->required();
  app->add_option("--pictures", o.pictures,
                  "folder for charts.png (a colour a chart) and density.png (too coarse blue, right green, too fine red, overlap magenta)")
      ->type_name("DIR");
  app->add_option("--map-size", o.uv.mapSize, "side of a light map in texels [default: as for a bake]")->check(CLI::Range(4, 16384));
  app->add_option("--texels-per-metre", o.uv.texelsPerMetre, "density when no size is given [default: as for a bake]")
      ->check(CLI::Range(1e-6, 1e6));
  addInputLimits(app, o.limits);
  app->add_flag("--json", o.json, "print the table as JSON");
  app->add_option("-j,--threads", o.threads, "threads [default: all]")->check(CLI::Range(1, 1024));
}

void addAttach(CLI::App* app, AttachOptions& o) {
  app->add_option("LEVEL", o.level, "rewritten level, .glb or .gltf")->required();
  app->add_option("OUT", o.baked, "folder of the bake")->required();
  app->add_option("-o,--out", o.out, "file to write, .glb or .gltf [default: attached.glb in OUT]");
  app->add_option("--tolerance", o.tolerance, "how far surfaces may have moved, as a share of the level's size")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 0.1));
  addInputLimits(app, o.limits);
  app->add_flag("--json", o.json, "print what was matched as JSON");
  app->add_option("-j,--threads", o.threads, "threads [default: all]")->check(CLI::Range(1, 1024));
}

void addFitAttenuation(CLI::App* app, FitAttenuationOptions& o) {
  app->add_option("--range", o.range_m, "where the light ends [m]")->required()->check(CLI::Range(1e-6, 1e9));
  app->add_option(
         "--falloff", o.fallOff,
         "inverse-square, inverse-square-window (as KHR_lights_punctual ends it), inverse, smooth ((1 - (d/range)^2)^2), smoothstep, "
         "linear, suggested (c = 1, l = 2/range, q = 1/range^2), or a file with a distance and a value a line")
      ->required()
      ->type_name("KIND");
  app->add_option("--near", o.near_m,
                  "where the fit begins [m; default: a hundredth of the range where the fall-off has no upper end, else 0]")
      ->check(CLI::Range(1e-9, 1e9));
  app->add_flag("--json", o.json, "print the constants as JSON");
}

/// Lines of help end before this column, so that they can be read; descriptions begin at CLI11's.
constexpr std::size_t kHelpColumns = 110, kHelpStart = 30;

class WrappedHelp : public CLI::Formatter {
 public:
  WrappedHelp() { column_width(kHelpStart); }
  std::string make_option_desc(const CLI::Option* o) const override { return wrapped(o->get_description(), kHelpColumns - kHelpStart); }
  std::string make_footer(const CLI::App* app) const override {
    const std::string footer = app->get_footer();
    std::string out;
    std::string_view text = footer;
    while (!text.empty()) {  // a paragraph a line
      const std::string_view paragraph = text.substr(0, text.find('\n'));
      text.remove_prefix(std::min(text.size(), paragraph.size() + 1));
      out += wrapped(paragraph, kHelpColumns) + "\n";
    }
    return out;
  }
};

}  // namespace

Command parseCommandLine(int argc, const char* const* argv) {
  CLI::App app{"lmc: compiles the static light of a glTF level into light maps, and says how accurate they are"};
  app.name("lmc");
  app.formatter(std::make_shared<WrappedHelp>());  // verbs added from here on have it, too
  app.footer(kExitCodes);
  app.set_version_flag("--version", std::string("lmc ") + LMC_VERSION);
  app.require_subcommand(1);

  BakeOptions bake;
  CLI::App* bakeApp = app.add_subcommand("bake", "bake light maps of a level");
  addBake(bakeApp, bake);

  PlanOptions plan;
  CLI::App* planApp =
      app.add_subcommand("plan", "say which effects a bake would simulate, why, what each is worth and going to cost; writes nothing");
  addPlan(planApp, plan);

  CompareOptions compare;
  CLI::App* compareApp = app.add_subcommand("compare", "differences of two maps (EXR) or pictures (PNG, JPEG), channel by channel");
  addCompare(compareApp, compare);

  ShadeOptions shade;
  CLI::App* shadeApp = app.add_subcommand("shade", "picture of a level, baked or not, by the deferred reference shader");
  addShade(shadeApp, shade);

  CheckShaderOptions checkShader;
  CLI::App* checkShaderApp = app.add_subcommand(
      "check-shader", "draw a level with own shaders and with the reference, and name what is wrong; exit code 7 when they differ");
  addCheckShader(checkShaderApp, checkShader);

  VerifyOptions verify;
  CLI::App* verifyApp =
      app.add_subcommand("verify", "run analytic reference cases and tangent vectors through the libraries; exit code 6 when one fails");
  addVerify(verifyApp, verify);

  TangentsOptions tangents;
  CLI::App* tangentsApp = app.add_subcommand("tangents", "write tangents after MikkTSpace into a glTF file, where materials call for them");
  addTangents(tangentsApp, tangents);

  NormalsOptions normals;
  std::string normalsFrom, normalsAs = "height";
  CLI::App* normalsApp =
      app.add_subcommand("normals", "normal maps: to and from tangent space, from heights, pictures and models of more polygons");
  addNormals(normalsApp, normals, normalsFrom, normalsAs);
  AoJobOptions occlusion;
  CLI::App* aoApp = app.add_subcommand("ao", "ambient occlusion of a model: a map over its own UVs, or a value a vertex");
  addAo(aoApp, occlusion);
  UnwrapOptions unwrap;
  CLI::App* unwrapApp = app.add_subcommand("unwrap", "make, repair or keep light-map UVs, and write the level with them");
  addUnwrap(unwrapApp, unwrap);

  InfoOptions info;
  CLI::App* infoApp = app.add_subcommand("info", "table of a level's objects: area, light-map UVs and their faults, texel density, memory");
  addInfo(infoApp, info);

  AttachOptions attach;
  CLI::App* attachApp = app.add_subcommand(
      "attach", "put the maps of a bake on a level that an optimiser rewrote; exit code 5 when objects are left without");
  addAttach(attachApp, attach);

  FitAttenuationOptions fit;
  CLI::App* fitApp = app.add_subcommand("fit-attenuation", "constants of the classic attenuation that come nearest to a wished fall-off");
  addFitAttenuation(fitApp, fit);

  StudyOptions study;
  std::string ladder;
  CLI::App* studyApp = app.add_subcommand("study", "what accuracy costs on a level: a ladder of bakes, a table, a plot and a page");
  addStudy(studyApp, study, ladder);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) {  // --help, --version
      std::ostringstream text, unused;
      app.exit(e, text, unused);
      return ShowText{text.str()};
    }
    std::string what = e.what();
    for (char& c : what)
      if (c == '\n') c = ' ';
    throw Error(Exit::Usage, "lmc", "", what + kSeeHelp);
  }
  for (const BakeOptions* o : {&bake, &plan.bake, &study.bake})
    if (o->solver != Solver::Auto && o->solver != Solver::Shooting && (o->passes > 0 || o->snapshot))
      throw Error(Exit::Usage, "lmc", "", "only --solver shooting has passes: leave out --passes and --snapshot, or take it");
  if (bake.time_s > 0.0)
    for (const char* option : {"--max-error", "--preset", "--gather-rounds", "--gather-rays", "--audit"})
      if (bakeApp->count(option) > 0) throw Error(Exit::Usage, "lmc", "", fmt::format("--time finds its own goal: leave out {}", option));
  checkAo(bake.ao);
  checkAo(plan.bake.ao);
  askForBent(bake, bakeApp->count("--bent") > 0);
  askForBent(plan.bake, planApp->count("--bent") > 0);
  if (*aoApp) return settled(occlusion);
  if (*bakeApp) return bake;
  if (*planApp) return plan;
  if (*compareApp) return compare;
  if (*checkShaderApp) return checkShader;
  if (*verifyApp) return verify;
  if (*tangentsApp) return tangents;
  if (*normalsApp) return settled(normals, normalsFrom, normalsAs);
  if (*unwrapApp) return unwrap;
  if (*infoApp) return info;
  if (*attachApp) return attach;
  if (*fitApp) return fit;
  if (*studyApp) return settled(study, ladder);
  return shade;
}

}  // namespace lmc
