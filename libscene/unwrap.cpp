#include "libscene/unwrap.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <optional>
#include <unordered_map>

#include "libscene/cut_charts.h"
#include "libscene/place_charts.h"
#include "libscene/rng.h"
#include "libscene/tracer.h"

namespace lmc {

namespace {

constexpr double kDefaultTexelsPerMetre = 16.0;
constexpr int kLeastSide = 256;         // of a map whose size and density nobody named
constexpr int kMostSide = 4096;         // of a map whose size nobody named: then there are more of them
constexpr double kKnownStretch = 1.5;   // L2 up to which charts of the level are placed anew as they are
constexpr double kFaultyStretch = 3.0;  // L2 of an object from which its UVs are a fault
constexpr double kFaultyDensity = 4.0;  // times what the level names for the object, or a part of it
constexpr double kTight = 0.01;         // share of an object's texels that look-ups of another chart may reach
constexpr int kCures = 4;               // rounds of taking spoilt faces out of their charts

/// A shape that objects show, and where its charts come from.
struct Shape {
  std::uint32_t object = 0;  ///< the first that shows it
  std::vector<FlatChart> charts;
  bool known = false;  ///< some of them are the level's own
};

/// How an object shows a shape.
struct Show {
  std::uint32_t shape = 0;
  double scale = 1.0;     ///< of the object against the shape
  bool mirrored = false;  ///< its triangles run the other way about
};

std::uint32_t corner(const Scene& scene, const Object& o, std::uint32_t face, int k) {
  return scene.triangles[o.firstTriangle + face][k] - o.firstVertex;
}

/// How `o` shows what `other` shows, if it does: the same triangles, all edges in one ratio.
std::optional<Show> sameShape(const Scene& scene, const Object& o, const Object& other) {
  if (o.triangleCount != other.triangleCount || o.vertexCount != other.vertexCount) return std::nullopt;
  Show show;
  show.mirrored = corner(scene, o, 0, 1) != corner(scene, other, 0, 1);
  const auto length = [&](const Object& x, std::uint32_t a, std::uint32_t b) {
    return glm::distance(glm::dvec3(scene.positions_m[x.firstVertex + a]), glm::dvec3(scene.positions_m[x.firstVertex + b]));
  };
  double whole = 0.0, otherWhole = 0.0;
  for (std::uint32_t f = 0; f < o.triangleCount; ++f)
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = corner(scene, other, f, k), b = corner(scene, other, f, (k + 1) % 3);
      if (corner(scene, o, f, show.mirrored ? (3 - k) % 3 : k) != a) return std::nullopt;
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

class Layouter {
 public:
  Layouter(Scene& scene, const UvOptions& options, const Run& run) : scene_(scene), o_(options), run_(run) {}
  UvLayout layOut();

 private:
  bool receives(const Object& o) const { return o.receive && o.triangleCount > 0; }
  double densityOf(const Object& o) const { return o.texelsPerMetre > 0.0 ? o.texelsPerMetre : density_; }
  std::vector<UvFault> findFaults();
  void findTight(std::vector<std::uint32_t>& tight) const;
  void makeShapes();
  void place();
  void takeOut(const std::vector<std::pair<std::uint32_t, std::uint32_t>>& spoilt);
  void splitVertices();
  void describe();

  Scene& scene_;
  const UvOptions& o_;
  const Run& run_;
  UvLayout out_;
  double density_ = kDefaultTexelsPerMetre;
  bool densityNamed_ = false;
  std::vector<bool> faulty_;  // one an object
  std::vector<Shape> shapes_;
  std::vector<Show> shows_;                                     // one an object; of the faulty ones
  std::vector<std::pair<std::uint32_t, std::uint32_t>> items_;  // object and chart of its shape, to be placed
  ChartPlaces places_;
};

/// Objects whose texels another chart's bilinear look-ups reach.
void Layouter::findTight(std::vector<std::uint32_t>& tight) const {
  const int side = out_.side;
  const std::size_t size = std::size_t(side) * std::size_t(side) * std::size_t(out_.maps);
  if (side > 2 * kMostSide) return;  // so many texels are not kept twice; layouts for them are not tight
  // Charts by the triangles that share a place in the map, as findCharts() has them.
  std::vector<bool> skip(scene_.objects.size());
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i) skip[i] = faulty_[i] || !receives(scene_.objects[i]);
  const std::vector<std::uint32_t> chartOf = connectedByUv(scene_, skip).chartOf;
  std::vector<std::uint32_t> owner(size, kNone);  // a triangle that touches the texel
  const auto forTexels = [&](std::uint32_t t, auto f) {
    const std::size_t map = std::size_t(scene_.objectOf(t).map) * std::size_t(side);
    forTouched(texelCorners(scene_, t, side), side, side, [&](int y, int first, int last) {
      for (int x = first; x <= last; ++x) f((map + std::size_t(y)) * std::size_t(side) + std::size_t(x), x, y);
    });
  };
  for (std::uint32_t t = 0; t < chartOf.size(); ++t)
    if (chartOf[t] != kNone) forTexels(t, [&](std::size_t i, int, int) { owner[i] = t; });
  std::vector<double> texels(scene_.objects.size(), 0.0), reached(texels);
  for (std::size_t i = 0; i < size; ++i)
    if (owner[i] != kNone) texels[scene_.triangleObject[owner[i]]] += 1.0;
  std::vector<bool> counted(size, false);
  for (std::uint32_t t = 0; t < chartOf.size(); ++t) {
    if (chartOf[t] == kNone) continue;
    forTexels(t, [&](std::size_t i, int x, int y) {
      if (counted[i]) return;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          if (x + dx < 0 || x + dx >= side || y + dy < 0 || y + dy >= side) continue;
          const std::uint32_t other = owner[std::size_t(std::ptrdiff_t(i) + std::ptrdiff_t(dy) * side + dx)];
          if (other == kNone || chartOf[other] == chartOf[t]) continue;
          counted[i] = true;
          reached[scene_.triangleObject[t]] += 1.0;
          return;
        }
    });
  }
  for (std::uint32_t i = 0; i < texels.size(); ++i)
    if (reached[i] > kTight * texels[i]) tight.push_back(i);
}

std::vector<UvFault> Layouter::findFaults() {
  std::vector<UvFault> faults;
  faulty_.assign(scene_.objects.size(), false);
  const auto add = [&](UvFault f) {
    if (faulty_[f.object]) return;
    faulty_[f.object] = true;
    faults.push_back(std::move(f));
  };
  if (o_.mode == UvMode::New) {
    for (std::uint32_t i = 0; i < scene_.objects.size(); ++i)
      if (receives(scene_.objects[i])) add({UvFault::Kind::Missing, i, "", "--uv new"});
    return faults;
  }
  for (UvFault& f : uvFaults(scene_, out_.side)) add(std::move(f));
  if (o_.mode == UvMode::Keep) return faults;
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i) {
    const Object& o = scene_.objects[i];
    if (faulty_[i] || !receives(o)) continue;
    if (const double stretch = objectStretch(scene_, o); stretch > kFaultyStretch)
      add({UvFault::Kind::Stretch, i, "", fmt::format("light-map UVs of object '{}' stretch it by {:.3g}", o.path, stretch)});
    const double density = out_.side * std::sqrt(uvArea(scene_, o) / objectArea_m2(scene_, o));
    if (o.texelsPerMetre > 0.0 && (density > kFaultyDensity * o.texelsPerMetre || density < o.texelsPerMetre / kFaultyDensity))
      add({UvFault::Kind::Density, i, "",
           fmt::format("object '{}' has {:.3g} texels a metre and asks for {:g}", o.path, density, o.texelsPerMetre)});
  }
  std::vector<std::uint32_t> tight;
  findTight(tight);
  for (const std::uint32_t i : tight)
    add({UvFault::Kind::Padding, i, "",
         fmt::format("charts of object '{}' are nearer than 2 texels to others in a map of {} x {}", scene_.objects[i].path, out_.side,
                     out_.side)});
  // Primitives of a node share a map.
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> nodes;
  for (const UvFault& f : faults) nodes.emplace(std::pair(scene_.objects[f.object].node, scene_.objects[f.object].instance), f.object);
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i) {
    const Object& o = scene_.objects[i];
    if (const auto it = nodes.find({o.node, o.instance}); it != nodes.end() && receives(o) && !faulty_[i])
      add({UvFault::Kind::Padding, i, "",
           fmt::format("object '{}' shares a map with object '{}'", o.path, scene_.objects[it->second].path)});
  }
  return faults;
}

/// Charts of every faulty object, the same for those of one shape.
void Layouter::makeShapes() {
  shows_.resize(scene_.objects.size());
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<std::uint32_t>> known;  // shapes of a primitive
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
      for (FlatChart& c : cutCharts(surface, faces, run_)) charts.push_back(std::move(c));
      for (FlatChart& c : charts) alignChart(c);
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
  if (!taken && o_.mapSize == 0 && !densityNamed_ && scene_.mapResolution > 0) options.side = scene_.mapResolution;
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
        uses.push_back({&charts[c], densityOf(o) * shows_[i].scale, shows_[i].mirrored, group});
        items_.emplace_back(i, c);
      }
    }
    if (uses.empty()) return;
    std::optional<ChartPlaces> placed = placeCharts(uses, options, run_);
    if (placed && options.side == 0 && !densityNamed_ && placed->maps == 1 && placed->side < kLeastSide) {
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
    faces.erase(std::ranges::unique(faces).begin(), faces.end());
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

/// Vertices that lie at two places of the map become two.
void Layouter::splitVertices() {
  std::vector<std::vector<std::uint32_t>> itemsOf(scene_.objects.size());
  for (std::uint32_t i = 0; i < items_.size(); ++i) itemsOf[items_[i].first].push_back(i);
  Scene to;
  const auto copy = [&](std::uint32_t v, glm::vec2 uv) {
    to.positions_m.push_back(scene_.positions_m[v]);
    to.normals.push_back(scene_.normals[v]);
    to.uv0.push_back(scene_.uv0[v]);
    if (!scene_.uv1.empty()) to.uv1.push_back(scene_.uv1[v]);
    if (!scene_.colors.empty()) to.colors.push_back(scene_.colors[v]);
    to.sourceVertex.push_back(scene_.sourceVertex[v]);
    to.mapUv.push_back(uv);
  };
  std::map<std::uint32_t, std::uint32_t> texCoords;  // of a node: free for all of its primitives
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i)
    if (faulty_[i]) texCoords[scene_.objects[i].node] = std::max(texCoords[scene_.objects[i].node], scene_.objects[i].freeTexCoord);
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i) {
    Object& o = scene_.objects[i];
    const auto first = std::uint32_t(to.positions_m.size());
    if (!faulty_[i]) {
      for (std::uint32_t v = 0; v < o.vertexCount; ++v) copy(o.firstVertex + v, scene_.mapUv[o.firstVertex + v]);
      for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) scene_.triangles[t] += first - o.firstVertex;
    } else {
      std::vector<std::array<glm::vec2, 3>> uv(o.triangleCount);
      for (const std::uint32_t item : itemsOf[i]) {
        const FlatChart& c = shapes_[shows_[i].shape].charts[items_[item].second];
        for (std::size_t f = 0; f < c.faces.size(); ++f)
          for (int k = 0; k < 3; ++k)
            // A mirrored object has its second and third corners exchanged.
            uv[c.faces[f]][std::size_t(shows_[i].mirrored ? (3 - k) % 3 : k)] = places_.uv[item][c.corners[f][k]];
        o.map = places_.map[item];
      }
      std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> known;  // copies, by vertex and place
      for (std::uint32_t f = 0; f < o.triangleCount; ++f)
        for (int k = 0; k < 3; ++k) {
          std::uint32_t& v = scene_.triangles[o.firstTriangle + f][k];
          const glm::vec2 at = uv[f][std::size_t(k)];
          auto& same = known[combine(v, std::uint64_t(std::bit_cast<std::uint32_t>(at.x)) << 32 | std::bit_cast<std::uint32_t>(at.y))];
          const auto it = std::ranges::find_if(
              same, [&](std::uint32_t n) { return to.mapUv[n] == at && to.sourceVertex[n] == scene_.sourceVertex[v]; });
          if (it != same.end()) {
            v = *it;
            continue;
          }
          same.push_back(std::uint32_t(to.positions_m.size()));
          copy(v, at);
          v = same.back();
        }
      o.inMap = true;
      o.texCoord = texCoords[o.node];
    }
    o.firstVertex = first;
    o.vertexCount = std::uint32_t(to.positions_m.size()) - first;
  }
  scene_.positions_m = std::move(to.positions_m);
  scene_.normals = std::move(to.normals);
  scene_.uv0 = std::move(to.uv0);
  scene_.uv1 = std::move(to.uv1);
  scene_.colors = std::move(to.colors);
  scene_.sourceVertex = std::move(to.sourceVertex);
  scene_.mapUv = std::move(to.mapUv);
}

void Layouter::describe() {
  double covered = 0.0;
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i) {
    const Object& o = scene_.objects[i];
    ObjectUv& u = out_.objects[i];
    if (!receives(o)) continue;
    const double uv = uvArea(scene_, o);
    u.area_m2 = objectArea_m2(scene_, o);
    u.stretch = objectStretch(scene_, o);
    u.texels = uv * out_.side * out_.side;
    u.texelsPerMetre = u.area_m2 > 0.0 ? std::sqrt(u.texels / u.area_m2) : 0.0;
    covered += uv;
  }
  out_.efficiency = covered / out_.maps;
}

UvLayout Layouter::layOut() {
  if (o_.texelsPerMetre > 0.0 || scene_.texelsPerMetre > 0.0) {
    density_ = o_.texelsPerMetre > 0.0 ? o_.texelsPerMetre : scene_.texelsPerMetre;
    densityNamed_ = true;
  }
  // A density that was asked for goes before the level's size.
  out_.side = mapSide(scene_, o_.mapSize > 0 ? o_.mapSize : o_.texelsPerMetre > 0.0 ? 0 : scene_.mapResolution, density_);
  out_.objects.resize(scene_.objects.size());
  for (const Object& o : scene_.objects) out_.maps = std::max(out_.maps, int(o.map) + 1);
  for (std::uint32_t i = 0; i < scene_.objects.size(); ++i)
    if (receives(scene_.objects[i])) out_.objects[i].fate = ObjectUv::Fate::Kept;
  const std::vector<UvFault> faults = findFaults();
  if (!faults.empty() && o_.mode == UvMode::Keep) throw uvError(scene_, faults.front());
  if (!faults.empty()) {
    makeShapes();
    place();
    splitVertices();
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
  describe();
  return std::move(out_);
}

}  // namespace

UvLayout layOut(Scene& scene, const UvOptions& options, const Run& run) { return Layouter(scene, options, run).layOut(); }

}  // namespace lmc
