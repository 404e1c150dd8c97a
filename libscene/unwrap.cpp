#include "libscene/unwrap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "libscene/cut_charts.h"
#include "libscene/place_charts.h"
#include "libscene/texel_array.h"
#include "libscene/tracer.h"

namespace lmc {

namespace {

constexpr double kDefaultTexelsPerMetre = 16.0;
constexpr int kLeastSide = 256;             // of a map whose size and density nobody named
constexpr int kMostSide = 4096;             // of a map whose size nobody named: then there are more of them
constexpr double kKnownStretch = 1.5;       // L2 up to which charts of the level are placed anew as they are
constexpr double kFaultyStretch = 3.0;      // L2 of an object from which its UVs are a fault
constexpr double kFaultyDensity = 4.0;      // times what the level names for the object, or a part of it
constexpr double kTight = 0.01;             // share of an object's texels that another chart's look-ups may read
constexpr double kUsed = 0.7;               // share of a map that charts fill without their padding, about
constexpr double kLongest = 0.75;           // of a map's side: longer charts are cut
constexpr double kSmallBox = 0.005;         // of a map: smaller charts may leave their boxes empty
constexpr double kNegligibleWeight = 1e-3;  // of a texel in a look-up
constexpr int kCures = 4;                   // rounds of taking spoilt faces out of their charts

/// A shape that objects show, and where its charts come from.
struct Shape {
  std::uint32_t object = 0;  ///< the first that shows it
  std::vector<FlatChart> charts;
  bool known = false;  ///< some of them are the level's own
};

/// How an object shows a shape.
struct Show {
  std::uint32_t shape = 0;
  double scale = 1.0;   ///< of the object against the shape
  bool turned = false;  ///< its triangles run the other way about
};

std::uint32_t corner(const Scene& scene, const Object& o, std::uint32_t face, int k) {
  return scene.triangles[o.firstTriangle + face][k] - o.firstVertex;
}

/// How `o` shows what `other` shows, if it does: the same triangles, all edges in one ratio.
std::optional<Show> sameShape(const Scene& scene, const Object& o, const Object& other) {
  if (o.triangleCount != other.triangleCount || o.vertexCount != other.vertexCount) return std::nullopt;
  Show show;
  show.turned = corner(scene, o, 0, 1) != corner(scene, other, 0, 1);
  const auto length = [&](const Object& x, std::uint32_t a, std::uint32_t b) {
    return glm::distance(glm::dvec3(scene.positions_m[x.firstVertex + a]), glm::dvec3(scene.positions_m[x.firstVertex + b]));
  };
  double whole = 0.0, otherWhole = 0.0;
  for (std::uint32_t f = 0; f < o.triangleCount; ++f)
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = corner(scene, other, f, k), b = corner(scene, other, f, (k + 1) % 3);
      if (corner(scene, o, f, show.turned ? (3 - k) % 3 : k) != a) return std::nullopt;
      whole += length(o, a, b);
      otherWhole += length(other, a, b);
    }
  if (!(otherWhole > 0.0)) return std::nullopt;
  show.scale = whole / otherWhole;
  const double rounding = 1e-6 * whole / o.triangleCount;
  for (std::uint32_t f = 0; f < o.triangleCount; ++f)
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = corner(scene, other, f, k), b = corner(scene, other, f, (k + 1) % 3);
      const double l = length(o, a, b);
      if (std::abs(l - show.scale * length(other, a, b)) > 1e-3 * l + rounding) return std::nullopt;
    }
  return show;
}

double objectArea_m2(const Scene& scene, const Object& o) {
  double sum = 0.0;
  for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) sum += area_m2(scene.corners_m(t));
  return sum;
}

/// Of the map's unit square.
double uvArea(const Scene& scene, const Object& o) {
  double sum = 0.0;
  for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) {
    const glm::uvec3 v = scene.triangles[t];
    const glm::dvec2 a(scene.mapUv[v.x]), b = glm::dvec2(scene.mapUv[v.y]) - a, c = glm::dvec2(scene.mapUv[v.z]) - a;
    sum += 0.5 * std::abs(b.x * c.y - b.y * c.x);
  }
  return sum;
}

double objectStretch(const Scene& scene, const Object& o) {
  std::vector<glm::dvec3> positions(o.vertexCount);
  std::vector<glm::dvec2> uv(o.vertexCount);
  for (std::uint32_t v = 0; v < o.vertexCount; ++v) {
    positions[v] = glm::dvec3(scene.positions_m[o.firstVertex + v]);
    uv[v] = glm::dvec2(scene.mapUv[o.firstVertex + v]);
  }
  std::vector<glm::uvec3> triangles;
  for (std::uint32_t f = 0; f < o.triangleCount; ++f) triangles.push_back(scene.triangles[o.firstTriangle + f] - o.firstVertex);
  return stretchL2(positions, triangles, uv, triangles);
}

std::array<glm::dvec2, 3> texelCorners(const Scene& scene, std::uint32_t t, int side) {
  const glm::uvec3 v = scene.triangles[t];
  std::array<glm::dvec2, 3> out;
  for (int k = 0; k < 3; ++k) out[std::size_t(k)] = glm::clamp(double(side) * glm::dvec2(scene.mapUv[v[k]]), 0.0, double(side));
  return out;
}

bool receives(const Object& o) { return o.receive && o.triangleCount > 0; }

/// Objects with texels that bilinear look-ups of two charts read.
std::vector<std::uint32_t> tightObjects(const Scene& scene, const std::vector<bool>& faulty, int side, int maps) {
  if (side > 2 * kMostSide) return {};  // so many texels are not kept twice; layouts for them are not tight
  std::vector<bool> skip(scene.objects.size());
  for (std::uint32_t i = 0; i < scene.objects.size(); ++i) skip[i] = faulty[i] || !receives(scene.objects[i]);
  const std::vector<std::uint32_t> chartOf = connectedByUv(scene, skip).chartOf;
  TexelArray<std::uint32_t> reader;  // the first triangle that reads a texel of one map
  std::vector<double> texels(scene.objects.size(), 0.0), shared(texels);
  const auto readBy = [&](std::uint32_t t) {
    std::array<glm::dvec2, 3> c = texelCorners(scene, t, side);
    for (glm::dvec2& p : c) p += 0.5;
    // A place in cell (x, y) of the grid of texels' centres reads the four texels about it.
    const auto read = [&](int y, int first, int last) {
      for (int v = std::max(0, y - 1); v <= std::min(side - 1, y); ++v)
        for (int u = std::max(0, first - 1); u <= std::min(side - 1, last); ++u) {
          std::uint32_t& r = reader[std::size_t(v) * std::size_t(side) + std::size_t(u)];
          if (r == kNone) {
            r = t;
            texels[scene.triangleObject[t]] += 1.0;
          } else if (chartOf[r] != chartOf[t]) {
            shared[scene.triangleObject[t]] += 1.0;
            shared[scene.triangleObject[r]] += 1.0;
          }
        }
    };
    forTouched(c, side + 1, side + 1, read, kNegligibleWeight);
  };
  for (int map = 0; map < maps; ++map) {
    reader.assign(std::size_t(side) * std::size_t(side), kNone);
    for (const Object& o : scene.objects)
      for (std::uint32_t t = o.firstTriangle; o.map == std::uint32_t(map) && t < o.firstTriangle + o.triangleCount; ++t)
        if (chartOf[t] != kNone) readBy(t);
  }
  std::vector<std::uint32_t> tight;
  for (std::uint32_t i = 0; i < texels.size(); ++i)
    if (shared[i] > kTight * texels[i]) tight.push_back(i);
  return tight;
}

std::vector<UvFault> findFaults(const Scene& scene, UvMode mode, int side, int maps) {
  std::vector<UvFault> faults;
  std::vector<bool> faulty(scene.objects.size(), false);
  const auto add = [&](UvFault f) {
    if (faulty[f.object]) return;
    faulty[f.object] = true;
    faults.push_back(std::move(f));
  };
  if (mode == UvMode::New) {
    for (std::uint32_t i = 0; i < scene.objects.size(); ++i)
      if (receives(scene.objects[i])) add({UvFault::Kind::Missing, i, "", "--uv new"});
    return faults;
  }
  for (UvFault& f : uvFaults(scene, side)) add(std::move(f));
  if (mode == UvMode::Keep) return faults;
  for (std::uint32_t i = 0; i < scene.objects.size(); ++i) {
    const Object& o = scene.objects[i];
    if (faulty[i] || !receives(o)) continue;
    if (const double stretch = objectStretch(scene, o); stretch > kFaultyStretch)
      add({UvFault::Kind::Stretch, i, "", fmt::format("light-map UVs of object '{}' stretch it by {:.3g}", o.path, stretch)});
    const double density = side * std::sqrt(uvArea(scene, o) / objectArea_m2(scene, o));
    if (o.texelsPerMetre > 0.0 && (density > kFaultyDensity * o.texelsPerMetre || density < o.texelsPerMetre / kFaultyDensity))
      add({UvFault::Kind::Density, i, "",
           fmt::format("object '{}' has {:.3g} texels a metre and asks for {:g}", o.path, density, o.texelsPerMetre)});
  }
  for (const std::uint32_t i : tightObjects(scene, faulty, side, maps))
    add({UvFault::Kind::Padding, i, "",
         fmt::format("charts of object '{}' are nearer than 2 texels to others in a map of {} x {}", scene.objects[i].path, side, side)});
  // Primitives of a node share a map.
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> nodes;
  for (const UvFault& f : faults) nodes.emplace(std::pair(scene.objects[f.object].node, scene.objects[f.object].instance), f.object);
  for (std::uint32_t i = 0; i < scene.objects.size(); ++i) {
    const Object& o = scene.objects[i];
    if (const auto it = nodes.find({o.node, o.instance}); it != nodes.end() && receives(o) && !faulty[i])
      add({UvFault::Kind::Padding, i, "",
           fmt::format("object '{}' shares a map with object '{}'", o.path, scene.objects[it->second].path)});
  }
  return faults;
}

void describe(const Scene& scene, UvLayout& layout) {
  double covered = 0.0;
  for (std::uint32_t i = 0; i < scene.objects.size(); ++i) {
    const Object& o = scene.objects[i];
    ObjectUv& u = layout.objects[i];
    if (!receives(o)) continue;
    const double uv = uvArea(scene, o);
    u.area_m2 = objectArea_m2(scene, o);
    u.stretch = objectStretch(scene, o);
    u.texels = uv * layout.side * layout.side;
    u.texelsPerMetre = u.area_m2 > 0.0 ? std::sqrt(u.texels / u.area_m2) : 0.0;
    covered += uv;
  }
  layout.efficiency = covered / layout.maps;
}

struct Density {
  double texelsPerMetre;
  bool named;  ///< by the user or the level
};
Density densityFor(const Scene& scene, const UvOptions& o) {
  if (o.texelsPerMetre > 0.0) return {o.texelsPerMetre, true};
  if (scene.texelsPerMetre > 0.0) return {scene.texelsPerMetre, true};
  return {kDefaultTexelsPerMetre, false};
}

/// What the level has: size and number of maps.
UvLayout known(const Scene& scene, const UvOptions& o) {
  UvLayout out;
  // A density that was asked for goes before the level's size.
  out.side = mapSide(scene,
                     o.mapSize > 0            ? o.mapSize
                     : o.texelsPerMetre > 0.0 ? 0
                                              : scene.mapResolution,
                     densityFor(scene, o).texelsPerMetre);
  out.objects.resize(scene.objects.size());
  for (const Object& object : scene.objects) out.maps = std::max(out.maps, int(object.map) + 1);
  for (std::uint32_t i = 0; i < scene.objects.size(); ++i)
    if (receives(scene.objects[i])) out.objects[i].fate = ObjectUv::Fate::Kept;
  return out;
}

class Layouter {
 public:
  Layouter(Scene& scene, const UvOptions& options, const Run& run)
      : scene_(scene), o_(options), run_(run), out_(known(scene, options)), density_(densityFor(scene, options)) {}
  UvLayout layOut();

 private:
  double densityOf(const Object& o) const { return o.texelsPerMetre > 0.0 ? o.texelsPerMetre : density_.texelsPerMetre; }
  void makeShapes();
  void place();
  void takeOut(const std::vector<std::pair<std::uint32_t, std::uint32_t>>& spoilt);
  std::vector<CornerUvs> cornerUvs();

  Scene& scene_;
  const UvOptions& o_;
  const Run& run_;
  UvLayout out_;
  Density density_;
  std::vector<bool> faulty_;  // one an object
  std::vector<Shape> shapes_;
  std::vector<Show> shows_;                                     // one an object; of the faulty ones
  std::vector<std::pair<std::uint32_t, std::uint32_t>> items_;  // object and chart of its shape, to be placed
  ChartPlaces places_;
};

/// Charts of every faulty object, the same for those of one shape.
void Layouter::makeShapes() {
  shows_.resize(scene_.objects.size());
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<std::uint32_t>> known;  // shapes of a primitive
  double level = 0.0;                                                                   // texels of all that is placed
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i)
    if (const Object& o = scene_.objects[i]; faulty_[i]) level += objectArea_m2(scene_, o) * densityOf(o) * densityOf(o);
  std::uint32_t done = 0;
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i) {
    const Object& o = scene_.objects[i];
    run_.progress(0.5 * double(done++) / double(scene_.objects.size()));
    if (!faulty_[i]) continue;
    auto& shapes = known[{o.mesh, o.primitive}];
    std::optional<Show> show;
    for (const std::uint32_t s : shapes) {
      show = sameShape(scene_, o, scene_.objects[shapes_[s].object]);
      if (!show) continue;
      show->shape = s;
      break;
    }
    if (!show) {
      show = Show{std::uint32_t(shapes_.size()), 1.0, false};
      shapes.push_back(show->shape);
      shapes_.push_back({i, {}, false});
      const Surface surface = surfaceOf(scene_, o);
      std::vector<std::uint32_t> faces(o.triangleCount);
      for (std::uint32_t f = 0; f < o.triangleCount; ++f) faces[f] = f;
      auto& charts = shapes_.back().charts;
      if (o_.mode == UvMode::Repair && o.inMap) {
        KnownCharts kept = knownCharts(scene_, o, surface, kKnownStretch);
        charts = std::move(kept.charts);
        shapes_.back().known = !charts.empty();
        faces = std::move(kept.other);
      }
      for (FlatChart& c : charts) alignChart(c);
      // In units of the shape: the side and the area of a square that would hold the whole level.
      const double side_m = std::sqrt(level / kUsed) / densityOf(o);
      for (FlatChart& c : cutCharts(surface, faces, run_)) {
        alignChart(c);
        for (FlatChart& part : cutSprawling(std::move(c), kLongest * side_m, kSmallBox * side_m * side_m)) {
          acceptChart(part, surface, std::numeric_limits<double>::infinity());  // a part has its own scale
          charts.push_back(std::move(part));
        }
      }
    }
    shows_[i] = *show;
  }
}

void Layouter::place() {
  std::optional<TexelMask> taken;
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i) {
    const Object& o = scene_.objects[i];
    if (faulty_[i] || !receives(o)) continue;
    if (!taken) taken.emplace(out_.side, out_.side);
    for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) taken->add(texelCorners(scene_, t, out_.side));
  }
  PlaceOptions options;
  options.padding = o_.padding;
  options.maxMaps = o_.maxMaps;
  options.mostSide = kMostSide;
  options.side = taken ? out_.side : o_.mapSize;
  options.taken = taken ? &*taken : nullptr;
  options.fill = o_.texelsPerMetre == 0.0;
  if (!taken && o_.mapSize == 0 && !density_.named && scene_.mapResolution > 0) options.side = scene_.mapResolution;
  for (int round = 0;; ++round) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> groups;
    std::vector<ChartUse> uses;
    items_.clear();
    for (std::uint32_t i = 0; i < scene_.objects.size(); ++i) {
      if (!faulty_[i]) continue;
      const Object& o = scene_.objects[i];
      const std::uint32_t group = groups.try_emplace({o.node, o.instance}, std::uint32_t(groups.size())).first->second;
      const auto& charts = shapes_[shows_[i].shape].charts;
      for (std::uint32_t c = 0; c < charts.size(); ++c) {
        // Counter-clockwise is as the file has the triangles: the charts follow the scene's.
        const bool mirrored = scene_.objects[shapes_[shows_[i].shape].object].mirrored;
        uses.push_back({&charts[c], densityOf(o) * shows_[i].scale, mirrored, group});
        items_.emplace_back(i, c);
      }
    }
    if (uses.empty()) return;
    std::optional<ChartPlaces> placed = placeCharts(uses, options, run_);
    if (placed && options.side == 0 && !density_.named && placed->maps == 1 && placed->side < kLeastSide) {
      options.side = kLeastSide;
      options.fill = true;
      placed = placeCharts(uses, options, run_);
    }
    if (!placed)
      throw Error(
          Exit::Limit, scene_.file, "",
          fmt::format("{} charts do not fit into {} {} of {} x {}: fewer --texels-per-metre, a larger --map-size or more --max-maps",
                      uses.size(), o_.maxMaps, o_.maxMaps == 1 ? "map" : "maps", options.side > 0 ? options.side : kMostSide,
                      options.side > 0 ? options.side : kMostSide),
          "LMC_UV_FULL");
    places_ = std::move(*placed);
    if (places_.spoilt.empty() || round == kCures) break;
    takeOut(places_.spoilt);
  }
  if (options.side == 0 && places_.factor < 1.0)
    run_.warn({{},
               scene_.file.string(),
               "",
               fmt::format("{} maps of {} x {} hold the level at {:.3g} texels a metre, not at {:g}: more --max-maps", places_.maps,
                           places_.side, places_.side, places_.factor * density_.texelsPerMetre, density_.texelsPerMetre),
               "LMC_UV_DENSITY"});
  if (!places_.smaller.empty())
    run_.warn({{},
               scene_.file.string(),
               "",
               fmt::format("{} nodes do not fit into a map of {} x {} at their density and get fewer texels", places_.smaller.size(),
                           places_.side, places_.side),
               "LMC_UV_DENSITY"});
  out_.side = places_.side;
  out_.maps = places_.maps;
}

/// Faces that rounding spoils become charts of their own.
void Layouter::takeOut(const std::vector<std::pair<std::uint32_t, std::uint32_t>>& spoilt) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<std::uint32_t>> perChart;  // shape and chart
  for (const auto& [item, face] : spoilt) perChart[{shows_[items_[item].first].shape, items_[item].second}].push_back(face);
  for (auto& [where, faces] : perChart) {
    Shape& shape = shapes_[where.first];
    std::ranges::sort(faces);
    faces.erase(std::unique(faces.begin(), faces.end()), faces.end());
    const Surface surface = surfaceOf(scene_, scene_.objects[shape.object]);
    FlatChart rest = shape.charts[where.second];
    for (auto f = faces.rbegin(); f != faces.rend(); ++f) {
      shape.charts.push_back(flattenFace(surface, rest.faces[*f]));
      alignChart(shape.charts.back());
      rest.faces.erase(rest.faces.begin() + *f);
      rest.corners.erase(rest.corners.begin() + *f);
    }
    if (rest.faces.empty()) {
      rest = std::move(shape.charts.back());
      shape.charts.pop_back();
    }
    shape.charts[where.second] = std::move(rest);
  }
}

std::vector<CornerUvs> Layouter::cornerUvs() {
  std::map<std::uint32_t, std::uint32_t> texCoords;  // of a node: free for all of its primitives
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i)
    if (faulty_[i]) texCoords[scene_.objects[i].node] = std::max(texCoords[scene_.objects[i].node], scene_.objects[i].freeTexCoord);
  std::vector<CornerUvs> out(scene_.objects.size());
  for (std::uint32_t item = 0; item < items_.size(); ++item) {
    const auto [i, chart] = items_[item];
    Object& o = scene_.objects[i];
    out[i].resize(o.triangleCount);
    const FlatChart& c = shapes_[shows_[i].shape].charts[chart];
    for (std::size_t f = 0; f < c.faces.size(); ++f)
      for (int k = 0; k < 3; ++k)
        // Of one that is turned the second and third corners are exchanged.
        out[i][c.faces[f]][std::size_t(shows_[i].turned ? (3 - k) % 3 : k)] = places_.uv[item][c.corners[f][k]];
    o.map = places_.map[item];
    o.texCoord = texCoords[o.node];
  }
  return out;
}

UvLayout Layouter::layOut() {
  const std::vector<UvFault> faults = findFaults(scene_, o_.mode, out_.side, out_.maps);
  faulty_.assign(scene_.objects.size(), false);
  for (const UvFault& f : faults) faulty_[f.object] = true;
  if (!faults.empty() && o_.mode == UvMode::Keep) throw uvError(scene_, faults.front());
  if (!faults.empty()) {
    makeShapes();
    place();
    setMapUvs(scene_, cornerUvs());
    for (const UvFault& f : faults) {
      ObjectUv& u = out_.objects[f.object];
      u.because = f.text;
      u.fate = shapes_[shows_[f.object].shape].known ? ObjectUv::Fate::Repaired : ObjectUv::Fate::Made;
    }
    for (const auto& [object, chart] : items_) {
      const FlatChart& c = shapes_[shows_[object].shape].charts[chart];
      ++out_.objects[object].charts;
      ++out_.charts;
      out_.meanStretch += c.stretch;
    }
    out_.meanStretch /= std::max(1u, out_.charts);
  }
  describe(scene_, out_);
  return std::move(out_);
}

}  // namespace

UvLayout layOut(Scene& scene, const UvOptions& options, const Run& run) { return Layouter(scene, options, run).layOut(); }

UvState examineUvs(const Scene& scene, const UvOptions& options) {
  UvState out{known(scene, options), {}};
  out.faults = findFaults(scene, UvMode::Repair, out.layout.side, out.layout.maps);
  describe(scene, out.layout);
  return out;
}

void setMapUvs(Scene& scene, const std::vector<CornerUvs>& uvs) {
  Scene to;
  const auto copy = [&](std::uint32_t v, glm::vec2 uv) {
    to.positions_m.push_back(scene.positions_m[v]);
    to.normals.push_back(scene.normals[v]);
    to.uv0.push_back(scene.uv0[v]);
    if (!scene.uv1.empty()) to.uv1.push_back(scene.uv1[v]);
    if (!scene.colors.empty()) to.colors.push_back(scene.colors[v]);
    to.sourceVertex.push_back(scene.sourceVertex[v]);
    to.mapUv.push_back(uv);
  };
  for (std::uint32_t i = 0; i < scene.objects.size(); ++i) {
    Object& o = scene.objects[i];
    const auto first = std::uint32_t(to.positions_m.size());
    if (uvs[i].empty()) {
      for (std::uint32_t v = 0; v < o.vertexCount; ++v) copy(o.firstVertex + v, scene.mapUv[o.firstVertex + v]);
      for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) scene.triangles[t] += first - o.firstVertex;
    } else {
      std::vector<std::vector<std::uint32_t>> copies(o.vertexCount);
      for (std::uint32_t f = 0; f < o.triangleCount; ++f)
        for (int k = 0; k < 3; ++k) {
          std::uint32_t& v = scene.triangles[o.firstTriangle + f][k];
          const glm::vec2 at = uvs[i][f][std::size_t(k)];
          auto& same = copies[v - o.firstVertex];
          const auto it = std::ranges::find_if(same, [&](std::uint32_t n) { return to.mapUv[n] == at; });
          if (it == same.end()) {
            same.push_back(std::uint32_t(to.positions_m.size()));
            copy(v, at);
            v = same.back();
          } else {
            v = *it;
          }
        }
      o.inMap = true;
    }
    o.firstVertex = first;
    o.vertexCount = std::uint32_t(to.positions_m.size()) - first;
  }
  scene.positions_m = std::move(to.positions_m);
  scene.normals = std::move(to.normals);
  scene.uv0 = std::move(to.uv0);
  scene.uv1 = std::move(to.uv1);
  scene.colors = std::move(to.colors);
  scene.sourceVertex = std::move(to.sourceVertex);
  scene.mapUv = std::move(to.mapUv);
}

}  // namespace lmc
