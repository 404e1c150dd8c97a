#pragma once
/// Vertices and pictures of a level, and the volumes of lights, as GL objects. Private to shaders.
#include <map>
#include <utility>

#include "shaders/gl_program.h"
#include "shaders/sampling.h"

namespace lmc::shaders {

/// A mesh that is drawn from the start of its buffers.
struct GlMesh {
  GLuint array = 0;
  GLsizei count = 0;  ///< indices, or vertices where it has none
};

class GlLevel {
 public:
  GlLevel(const GlContext&, const ShadingLevel&, const LevelMaps&);

  /// Draws an object with a pass of the G-buffer, whose program is in use.
  void draw(const GlProgram&, const View&, std::uint32_t object);

  const GlMesh& sphere() const { return sphere_; }    ///< holds the unit sphere
  const GlMesh& cone() const { return cone_; }        ///< apex at the origin, holds the cone about -Z of length 1 and radius 1 there
  const GlMesh& screen() const { return screen_; }    ///< a triangle that holds the screen, in clip space
  const GlMesh& nothing() const { return nothing_; }  ///< for passes that have no attributes

 private:
  GLuint texture(std::uint32_t image, Encoding);
  GLuint floatTexture(int width, int height, GLenum from, const float* data);
  void bind(int unit, const Texture&, Encoding, GLuint otherwise);
  GLuint samplerFor(Wrap u, Wrap v);
  GlMesh upload(std::span<const glm::vec3> positions, std::span<const glm::uvec3> triangles);

  const GlContext& gl_;
  const ShadingLevel& level_;
  const LevelMaps& maps_;
  GLuint array_ = 0, white_ = 0, flat_ = 0;
  GlMesh sphere_, cone_, screen_, nothing_;
  std::map<std::pair<std::uint32_t, Encoding>, GLuint> textures_;
  std::map<std::pair<Wrap, Wrap>, GLuint> samplers_;
  std::vector<GLuint> lightMaps_, aoMaps_;
};

}  // namespace lmc::shaders
