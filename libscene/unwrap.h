#pragma once
/// Light-map UVs for a whole level: what is sound is kept, the rest is repaired or made, and all of it gets a place in one or more maps.
#include <array>
#include <string>
#include <vector>

#include "libscene/charts.h"
#include "libscene/run.h"
#include "libscene/scene.h"

namespace lmc {

enum class UvMode {
  Keep,    ///< as the level has them; faults are errors
  Repair,  ///< sound ones stay; charts of faulty ones are placed anew, and made anew where they fold or stretch
  New      ///< all are made
};

struct UvOptions {
  UvMode mode = UvMode::Repair;
  int mapSize = 0;              ///< side of a map [texels]; 0 = the level's own, else from the density
  double texelsPerMetre = 0.0;  ///< 0 = the level's own, else 16, and a map of at least 256 texels a side
  int padding = 2;              ///< texels between borders of charts that are placed; 2 keep bilinear look-ups apart
  int maxMaps = 16;
};

/// What became of an object's map UVs.
struct ObjectUv {
  enum class Fate { None, Kept, Repaired, Made } fate = Fate::None;  ///< None = it receives no light
  std::string because;                                               ///< the fault, where they were not kept
  std::uint32_t charts = 0;                                          ///< placed anew; 0 where they were kept
  double stretch = 0.0;                                              ///< L2 [sander2001], mean over its area; 1 = isometric, 0 = not known
  double texelsPerMetre = 0.0;                                       ///< square root of texels over area, in the mean
  double area_m2 = 0.0;
  double texels = 0.0;  ///< area in the map
};

struct UvLayout {
  int side = 0;  ///< of each map [texels]
  int maps = 1;
  std::vector<ObjectUv> objects;  ///< one an object of the scene
  std::uint32_t charts = 0;       ///< placed anew
  double meanStretch = 0.0;       ///< L2 of the charts that were placed anew, mean over charts
  double efficiency = 0.0;        ///< share of the maps' texels that lies under triangles
  bool changed() const { return charts > 0; }
};

/// Gives every object that receives light its map UVs: splits the scene's vertices at chart borders (Scene::sourceVertex tells whose copies
/// they are) and sets Object::map. New ones run counter-clockwise as the file has the triangles. Objects of one node share a map. Throws
/// Error for faults when they are to be kept, and Limit where the charts do not fit into the maps allowed. The same layout for any number
/// of threads.
UvLayout layOut(Scene&, const UvOptions&, const Run&);

/// What layOut() would find fault with in the map UVs that the level has, object by object: uvFaults(), and an L2 stretch above 3, a
/// density more than 4 times off what extras.lmc.texelsPerMetre asks for, or charts so near to others that bilinear look-ups reach them.
struct UvState {
  UvLayout layout;  ///< of what is there
  std::vector<UvFault> faults;
};
UvState examineUvs(const Scene&, const UvOptions&);

/// Map UVs of an object's triangles, corner by corner.
using CornerUvs = std::vector<std::array<glm::vec2, 3>>;

/// Gives objects new map UVs: vertices that lie at two places of the map become two. `uvs` has an entry an object; empty = its UVs stay.
void setMapUvs(Scene&, const std::vector<CornerUvs>& uvs);

}  // namespace lmc
