#include "lmc/uv_jobs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "libscene/files.h"
#include "libscene/gltf_edit.h"
#include "libscene/image_file.h"
#include "libscene/level_out.h"
#include "libscene/pack.h"
#include "libscene/parallel.h"
#include "libscene/polygon2.h"
#include "libscene/rng.h"
#include "libscene/tracer.h"
#include "libscene/transfer_uvs.h"
#include "lmc/bake.h"
#include "lmc/jobs.h"
#include "lmc/memory.h"
#include "lmc/report.h"
#include "lmc/sidecar.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;

/// Texels a metre that an object asks for, or that the level has in the mean.
double wantedDensity(const Object& o, const UvLayout& layout) {
  if (o.texelsPerMetre > 0.0) return o.texelsPerMetre;
  double texels = 0.0, area_m2 = 0.0;
  for (const ObjectUv& u : layout.objects) {
    texels += u.texels;
    area_m2 += u.area_m2;
  }
  return area_m2 > 0.0 ? std::sqrt(texels / area_m2) : 0.0;
}

std::string table(const Scene& scene, const UvLayout& layout, const std::vector<std::string>& remarks) {
  std::string text = fmt::format("{:<32} {:>9} {:>10} {:>10} {:>9} {:>8} {:>4}  {}\n", "object", "triangles", "area m2", "texels",
                                 "texels/m", "stretch", "map", "light-map UVs");
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    const Object& o = scene.objects[i];
    const ObjectUv& u = layout.objects[i];
    if (u.fate == ObjectUv::Fate::None) continue;
    text += fmt::format("{:<32} {:>9} {:>10.4g} {:>10.0f} {:>9.3g} {:>8.3f} {:>4}  {}\n", o.path, o.triangleCount, u.area_m2, u.texels,
                        u.texelsPerMetre, u.stretch, o.map, remarks[i]);
  }
  return text;
}

}  // namespace

Exit unwrap(const UnwrapOptions& options) {
  const Run run = talkingRun(options.threads);
  withThreads(run, [&] {
    Scene scene = loadLevel(options.level, options.limits, run);
    refuseSameFile(options.level, scene, options.out);
    const UvLayout layout = layOut(scene, options.uv, run);
    findCharts(scene, layout.side, run);  // what was made is checked as what was found
    LevelMarks marks;
    marks.newUvs = layout.changed();
    marks.side = layout.side;
    marks.asText = isGltfText(options.out);
    writeBytes(options.out, levelWithMaps(options.level, options.limits, scene, marks));
    if (options.json) {
      fmt::print("{}\n", uvOf(layout, scene).dump(2));
      return;
    }
    constexpr const char* kFates[] = {"", "kept", "repaired", "made"};
    std::vector<std::string> remarks;
    for (const ObjectUv& u : layout.objects)
      remarks.push_back(u.charts > 0 ? fmt::format("{} ({} charts): {}", kFates[std::size_t(u.fate)], u.charts, u.because)
                                     : kFates[std::size_t(u.fate)]);
    fmt::print("{}{} {} of {} x {}, {:.1f} % used, {} charts placed, mean stretch {:.3f}\n", table(scene, layout, remarks), layout.maps,
               layout.maps == 1 ? "map" : "maps", layout.side, layout.side, 100.0 * layout.efficiency, layout.charts, layout.meanStretch);
  });
  return Exit::Done;
}

namespace {

/// Pictures of the maps one below the other: charts in hues of their own, and densities against what is wanted.
struct UvPictures {
  Image<glm::u8vec4> charts, density;
};

constexpr glm::u8vec4 kOverlap{255, 0, 255, 255};

/// Blue at half of what is wanted and less, green where it is right, red at twice and more.
glm::u8vec4 colourOfDensity(double ratio) {
  const double at = std::clamp(std::log2(std::max(ratio, 1e-9)), -1.0, 1.0);
  const glm::dvec3 c = at < 0.0 ? glm::mix(glm::dvec3(40, 220, 60), glm::dvec3(40, 60, 255), -at)
                                : glm::mix(glm::dvec3(40, 220, 60), glm::dvec3(255, 40, 30), at);
  return {std::uint8_t(c.x), std::uint8_t(c.y), std::uint8_t(c.z), 255};
}

glm::u8vec4 colourOfChart(std::uint32_t chart) {
  const std::uint64_t h = mix64(chart + 1);
  return {std::uint8_t(60 + (h & 127)), std::uint8_t(60 + ((h >> 8) & 127)), std::uint8_t(60 + ((h >> 16) & 127)), 255};
}

UvPictures picturesOf(const Scene& scene, const UvLayout& layout) {
  const int side = layout.side;
  UvPictures out{{side, side * layout.maps, glm::u8vec4(0, 0, 0, 255)}, {side, side * layout.maps, glm::u8vec4(0, 0, 0, 255)}};
  std::vector<bool> skip(scene.objects.size());
  for (std::size_t i = 0; i < skip.size(); ++i) skip[i] = !scene.objects[i].receive || !scene.objects[i].inMap;
  const Charts charts = connectedByUv(scene, skip);
  std::vector<double> covered(std::size_t(side) * std::size_t(side) * std::size_t(layout.maps), 0.0);
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    if (charts.chartOf[t] == kNone) continue;
    const Object& o = scene.objectOf(t);
    std::array<glm::dvec2, 3> c;
    for (int k = 0; k < 3; ++k)
      c[std::size_t(k)] = glm::clamp(double(side) * glm::dvec2(scene.mapUv[scene.triangles[t][k]]), 0.0, double(side));
    const glm::dvec2 a = c[1] - c[0], b = c[2] - c[0];
    const double texels = 0.5 * std::abs(a.x * b.y - a.y * b.x), area = area_m2(scene.corners_m(t));
    const double ratio = std::sqrt(texels / std::max(1e-30, area)) / std::max(1e-30, wantedDensity(o, layout));
    forTouched(c, side, side, [&](int y, int first, int last) {
      for (int x = first; x <= last; ++x) {
        // What the triangle covers of the texel: more than all of it is an overlap.
        Polygon2 cell({c[0], c[1], c[2]});
        if (a.x * b.y - a.y * b.x < 0.0) cell.assign({c[0], c[2], c[1]});
        cell.clip({double(x), double(y)}, {1.0, 0.0});
        cell.clip({double(x + 1), double(y)}, {0.0, 1.0});
        cell.clip({double(x + 1), double(y + 1)}, {-1.0, 0.0});
        cell.clip({double(x), double(y + 1)}, {0.0, -1.0});
        const int row = int(o.map) * side + y;
        double& sum = covered[std::size_t(row) * std::size_t(side) + std::size_t(x)];
        sum += std::abs(cell.area());
        const bool over = sum > 1.01;
        out.charts.at(x, row) = over ? kOverlap : colourOfChart(charts.chartOf[t]);
        out.density.at(x, row) = over ? kOverlap : colourOfDensity(ratio);
      }
    });
  }
  return out;
}

}  // namespace

Exit showInfo(const InfoOptions& options) {
  const Run run = talkingRun(options.threads);
  withThreads(run, [&] {
    const Scene scene = loadLevel(options.level, options.limits, run);
    const UvState state = examineUvs(scene, options.uv);
    std::vector<std::string> remarks(scene.objects.size(), "sound");
    for (const UvFault& f : state.faults) remarks[f.object] = f.text;
    BakeOptions bake;
    bake.uv = options.uv;
    const MemoryPlan memory = planMemory(scene, bake, state.layout.side, state.layout.maps, true, true, memoryBytes());
    if (!options.pictures.empty()) {
      const UvPictures pictures = picturesOf(scene, state.layout);
      OutputSet set(options.pictures);
      for (const auto& [name, image] : {std::pair("charts.png", &pictures.charts), std::pair("density.png", &pictures.density)}) {
        const std::vector<std::uint8_t> png = encodePng(*image, false);
        set.open(name).write(png.data(), png.size());
      }
      set.commit();
    }
    if (options.json) {
      Json out = uvOf(state.layout, scene);
      for (Json& object : out["objects"]) {
        const auto o = std::ranges::find(scene.objects, object["object"].get<std::string>(), &Object::path);
        if (const std::string& remark = remarks[std::size_t(o - scene.objects.begin())]; remark != "sound") object["fault"] = remark;
      }
      out["triangles"] = scene.triangles.size();
      out["lights"] = scene.lights.size();
      out["faults"] = state.faults.size();
      out["memory_bytes"] = memory.peak_bytes();
      out["disk_bytes"] = memory.disk_bytes();
      fmt::print("{}\n", out.dump(2));
      return;
    }
    fmt::print("{}{} triangles, {} lights; {} {} of {} x {}, {:.1f} % used; {} objects with faults; a bake takes about {}\n",
               table(scene, state.layout, remarks), scene.triangles.size(), scene.lights.size(), state.layout.maps,
               state.layout.maps == 1 ? "map" : "maps", state.layout.side, state.layout.side, 100.0 * state.layout.efficiency,
               state.faults.size(), sizeText(memory));
  });
  return Exit::Done;
}

Exit attach(const AttachOptions& options) {
  const Run run = talkingRun(options.threads);
  const nlohmann::json sidecar = readSidecar(options.baked);
  const std::filesystem::path out = options.out.empty() ? options.baked / "attached.glb" : options.out;
  Exit result = Exit::Done;
  withThreads(run, [&] {
    const Scene baked = loadLevel(options.baked / "level.glb", options.limits, run.silent());
    Scene scene = loadLevel(options.level, options.limits, run);
    refuseSameFile(options.level, scene, out);
    LevelMarks marks;
    for (const auto& m : sidecar["maps"]) {
      marks.maps.push_back({m.value("file", std::string()), m.value("scale", 1.0)});
      marks.side = m.value("width", 0);
    }
    for (const Object& o : baked.objects)
      if (o.map >= marks.maps.size())
        throw Error(Exit::Broken, options.baked / "level.lmc.json", "/maps", "lacks a map that the level names");
    for (const Light& l : scene.lights) marks.bakedLightNodes.push_back(l.node);
    marks.newUvs = true;
    marks.asText = isGltfText(out);
    const TransferReport report = transferUvs(baked, marks.side, scene, options.tolerance);
    for (const auto& [object, why] : report.unmatched)
      run.warn({{},
                options.level.string(),
                fmt::format("/nodes/{}", scene.objects[object].node),
                fmt::format("object '{}' gets no light map: {}", scene.objects[object].path, why),
                "LMC_ATTACH"});
    writeBytes(out, levelWithMaps(options.level, options.limits, scene, marks));
    if (options.json) {
      Json json = {{"file", out.filename().string()}, {"matched", Json::array()}, {"unmatched", Json::array()}};
      for (const std::uint32_t i : report.matched) json["matched"].push_back(scene.objects[i].path);
      for (const auto& [i, why] : report.unmatched) json["unmatched"].push_back({{"object", scene.objects[i].path}, {"because", why}});
      fmt::print("{}\n", json.dump(2));
    } else {
      fmt::print("{}: {} objects have their light map, {} have none\n", out.string(), report.matched.size(), report.unmatched.size());
    }
    if (!report.unmatched.empty()) result = Exit::GoalMissed;
  });
  return result;
}

}  // namespace lmc
