#pragma once
/// A glTF file being changed: what is not touched goes out as it came in, unknown extensions, names and extras included.
#include <cstdint>
#include <filesystem>
#include <glm/glm.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "libscene/level.h"

namespace lmc {

/// Whether a file of this name is glTF text, not a GLB.
inline bool isGltfText(const std::filesystem::path& file) { return file.extension() == ".gltf"; }

/// A primitive's vertices and triangles anew.
struct NewVertices {
  std::vector<std::uint32_t> source;  ///< for each new vertex the old one that it repeats
  std::vector<glm::uvec3> triangles;  ///< into the new ones
};

class GltfEdit {
 public:
  using Json = nlohmann::ordered_json;

  /// Reads and checks the file, and makes its buffers one. Throws Error as loadLevel does.
  GltfEdit(const std::filesystem::path& level, const LoadLimits& limits);
  ~GltfEdit();

  Json& json();

  /// Pictures that are files or data URIs become buffer views, so that the file stands alone; those that cannot be read stay what they are.
  void embedImages();
  /// Throws Error where the files that `scene` was made of are no longer what they were then. To be asked after embedImages().
  void refuseChanged(const Scene& scene) const;

  /// Triangles of a primitive, as it is now, as vertices of its own: strips, fans and lists alike, those without area too. None for points
  /// and lines.
  std::vector<glm::uvec3> triangles(std::uint32_t mesh, std::uint32_t primitive) const;
  /// An attribute as floats, `components` a vertex; empty where the primitive has it not.
  std::vector<float> attribute(std::uint32_t mesh, std::uint32_t primitive, const char* name, int components) const;

  /// EXT_mesh_gpu_instancing of a node as nodes of their own, without a mesh: only the members translation, rotation, scale. Takes the
  /// extension off the node. Empty where it has none.
  std::vector<Json> expandInstances(std::uint32_t node);

  /// A new image object, to be put under "images", whose bytes are in the file.
  Json imageOf(std::span<const std::uint8_t> bytes);
  /// A new accessor of floats for vertices, `components` 1 to 4 an element; the same floats are written once.
  std::uint32_t addFloats(std::span<const float> values, int components);
  /// A new accessor of triangles, in the smallest type that holds them.
  std::uint32_t addTriangles(std::span<const glm::uvec3> triangles);
  /// `primitive` with other vertices: every attribute and morph target follows them, in its own component type. The same
  /// vertices for the same accessor are written once.
  Json withVertices(const Json& primitive, const NewVertices& vertices);

  /// Meshes, accessors and views that nothing has any more go, with their bytes. Does nothing where an extension is in use of which it is
  /// not known what it points to.
  void dropUnused();

  /// One self-contained GLB. Throws Error Limit above 4 GiB.
  std::vector<std::uint8_t> glb();
  /// The same as glTF text, its buffer a data URI.
  std::vector<std::uint8_t> gltf();

 private:
  void finish();
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace lmc
