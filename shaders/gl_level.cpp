#include "shaders/gl_level.h"

#include <cmath>
#include <cstddef>

#include "libscene/constants.h"

namespace lmc::shaders {

namespace {

struct Vertex {
  glm::vec3 position, normal;
  glm::vec4 tangent;
  glm::vec2 uv0, uv1, mapUv;
  glm::vec4 color;
};

std::vector<Vertex> verticesOf(const ShadingLevel& level) {
  const Scene& s = level.scene;
  std::vector<Vertex> out(s.positions_m.size());
  for (std::size_t v = 0; v < out.size(); ++v)
    out[v] = {level.positions_m[v],
              level.normals[v],
              level.tangents[v],
              s.uv0[v],
              s.uv1.empty() ? glm::vec2(0.0f) : s.uv1[v],
              s.mapUv[v],
              s.colors.empty() ? glm::vec4(1.0f) : s.colors[v]};
  return out;
}

struct Mesh {
  std::vector<glm::vec3> positions;
  std::vector<glm::uvec3> triangles;
};

/// A sphere of latitudes whose faces touch the unit sphere from outside; fronts outwards.
Mesh sphereMesh() {
  constexpr int kAround = 24, kDown = 12;
  // The middle of a face is nearer than its corners by the cosines of half a step either way.
  const float radius = float(1.0 / (std::cos(kPi / kAround) * std::cos(0.5 * kPi / kDown)));
  Mesh out;
  for (int j = 0; j <= kDown; ++j)
    for (int i = 0; i <= kAround; ++i) {
      const double theta = kPi * j / kDown, phi = 2.0 * kPi * i / kAround;
      out.positions.push_back(radius * glm::vec3(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)));
    }
  for (int j = 0; j < kDown; ++j)
    for (int i = 0; i < kAround; ++i) {
      const auto a = std::uint32_t(j * (kAround + 1) + i), b = a + kAround + 1;
      out.triangles.emplace_back(a, a + 1, b);
      out.triangles.emplace_back(a + 1, b + 1, b);
    }
  return out;
}

/// A pyramid whose sides touch the cone from outside; fronts outwards.
Mesh coneMesh() {
  constexpr std::uint32_t kAround = 32;
  const double radius = 1.0 / std::cos(kPi / kAround);
  Mesh out;
  out.positions = {{0, 0, 0}, {0, 0, -1}};
  for (std::uint32_t i = 0; i < kAround; ++i) {
    const double phi = 2.0 * kPi * i / kAround;
    out.positions.emplace_back(radius * std::cos(phi), radius * std::sin(phi), -1.0);
  }
  for (std::uint32_t i = 0; i < kAround; ++i) {
    const std::uint32_t a = 2 + i, b = 2 + (i + 1) % kAround;
    out.triangles.emplace_back(0u, a, b);
    out.triangles.emplace_back(1u, b, a);
  }
  return out;
}

GLenum wrapOf(Wrap wrap) { return GLenum(wrap == Wrap::Clamp ? GL_CLAMP_TO_EDGE : wrap == Wrap::Mirror ? GL_MIRRORED_REPEAT : GL_REPEAT); }

/// The textures of a material by their units, as material.glsl numbers them.
std::array<Texture, 6> texturesOf(const Material& m, const Look& look) {
  return {m.baseColorTexture, look.roughnessTexture, look.specularTexture, look.normalTexture, m.emissionTexture, look.occlusionTexture};
}

}  // namespace

GlLevel::GlLevel(const GlContext& gl, const ShadingLevel& level, const LevelMaps& maps) : gl_(gl), level_(level), maps_(maps) {
  gl.PixelStorei(GL_UNPACK_ALIGNMENT, 1);
  const std::vector<Vertex> vertices = verticesOf(level);
  const std::vector<glm::uvec3>& triangles = level.scene.triangles;
  GLuint buffers[2];
  gl.GenVertexArrays(1, &array_);
  gl.BindVertexArray(array_);
  gl.GenBuffers(2, buffers);
  gl.BindBuffer(GL_ARRAY_BUFFER, buffers[0]);
  gl.BufferData(GL_ARRAY_BUFFER, GLsizeiptr(vertices.size() * sizeof(Vertex)), vertices.data(), GL_STATIC_DRAW);
  gl.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers[1]);
  gl.BufferData(GL_ELEMENT_ARRAY_BUFFER, GLsizeiptr(triangles.size() * sizeof(glm::uvec3)), triangles.data(), GL_STATIC_DRAW);
  const struct {
    int components;
    std::size_t offset;
  } attributes[] = {{3, offsetof(Vertex, position)}, {3, offsetof(Vertex, normal)}, {4, offsetof(Vertex, tangent)},
                    {2, offsetof(Vertex, uv0)},      {2, offsetof(Vertex, uv1)},    {2, offsetof(Vertex, mapUv)},
                    {4, offsetof(Vertex, color)}};
  for (GLuint a = 0; a < std::size(attributes); ++a) {
    gl.EnableVertexAttribArray(a);
    gl.VertexAttribPointer(a, attributes[a].components, GL_FLOAT, GL_FALSE, sizeof(Vertex),
                           reinterpret_cast<const void*>(attributes[a].offset));
  }
  gl.GenVertexArrays(1, &nothing_.array);
  const Mesh sphere = sphereMesh(), cone = coneMesh();
  sphere_ = upload(sphere.positions, sphere.triangles);
  cone_ = upload(cone.positions, cone.triangles);
  screen_ = upload(std::array{glm::vec3(-1, -1, 0), glm::vec3(3, -1, 0), glm::vec3(-1, 3, 0)}, std::array{glm::uvec3(0, 1, 2)});
  const float white[4] = {1, 1, 1, 1}, flat[4] = {0.5f, 0.5f, 1, 1};
  white_ = floatTexture(1, 1, GL_RGBA, white);
  flat_ = floatTexture(1, 1, GL_RGBA, flat);
  for (std::size_t k = 0; k < maps.illuminance.size(); ++k) {
    Image<Rgb> stored = maps.illuminance[k];
    for (Rgb& texel : stored.pixels) texel /= float(maps.scale(k));
    lightMaps_.push_back(floatTexture(stored.width, stored.height, GL_RGB, &stored.pixels[0].x));
  }
  for (const Image<float>& map : maps.openness) aoMaps_.push_back(floatTexture(map.width, map.height, GL_RED, map.pixels.data()));
  gl.check("loading the level");
}

GlMesh GlLevel::upload(std::span<const glm::vec3> positions, std::span<const glm::uvec3> triangles) {
  GlMesh out;
  GLuint buffers[2];
  gl_.GenVertexArrays(1, &out.array);
  gl_.BindVertexArray(out.array);
  gl_.GenBuffers(2, buffers);
  gl_.BindBuffer(GL_ARRAY_BUFFER, buffers[0]);
  gl_.BufferData(GL_ARRAY_BUFFER, GLsizeiptr(positions.size_bytes()), positions.data(), GL_STATIC_DRAW);
  gl_.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers[1]);
  gl_.BufferData(GL_ELEMENT_ARRAY_BUFFER, GLsizeiptr(triangles.size_bytes()), triangles.data(), GL_STATIC_DRAW);
  gl_.EnableVertexAttribArray(0);
  gl_.VertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(glm::vec3), nullptr);
  out.count = GLsizei(3 * triangles.size());
  return out;
}

/// Kept as 32-bit floats: the filter of 8-bit pictures has weights of 8 bits in software. Samplers say how it is read.
GLuint GlLevel::floatTexture(int width, int height, GLenum from, const float* data) {
  GLuint out = 0;
  gl_.GenTextures(1, &out);
  gl_.BindTexture(GL_TEXTURE_2D, out);
  const GLint inside = from == GL_RED ? GL_R32F : from == GL_RGB ? GL_RGB32F : GL_RGBA32F;
  gl_.TexImage2D(GL_TEXTURE_2D, 0, inside, width, height, 0, from, GL_FLOAT, data);
  return out;
}

GLuint GlLevel::texture(std::uint32_t image, Encoding encoding) {
  const auto [it, isNew] = textures_.try_emplace({image, encoding}, 0);
  if (!isNew) return it->second;
  const Image<glm::u8vec4>& from = level_.scene.images[image];
  std::vector<glm::vec4> linear;
  linear.reserve(from.pixels.size());
  for (const glm::u8vec4& p : from.pixels) linear.emplace_back(encoding == Encoding::Srgb ? linearOfSrgb(p) : glm::dvec4(p) / 255.0);
  it->second = floatTexture(from.width, from.height, GL_RGBA, &linear[0].x);
  gl_.check("loading a texture");
  return it->second;
}

GLuint GlLevel::samplerFor(Wrap u, Wrap v) {
  const auto [it, isNew] = samplers_.try_emplace({u, v}, 0);
  if (!isNew) return it->second;
  gl_.GenSamplers(1, &it->second);
  gl_.SamplerParameteri(it->second, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
  gl_.SamplerParameteri(it->second, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  gl_.SamplerParameteri(it->second, GL_TEXTURE_WRAP_S, GLint(wrapOf(u)));
  gl_.SamplerParameteri(it->second, GL_TEXTURE_WRAP_T, GLint(wrapOf(v)));
  return it->second;
}

void GlLevel::bind(int unit, const Texture& t, Encoding encoding, GLuint otherwise) {
  gl_.ActiveTexture(GLenum(GL_TEXTURE0 + unit));
  const GLuint name = t ? texture(t.image, encoding) : otherwise;  // a new one is bound while it is made
  gl_.BindTexture(GL_TEXTURE_2D, name);
  gl_.BindSampler(GLuint(unit), samplerFor(t.wrapU, t.wrapV));
}

void GlLevel::draw(const GlProgram& program, const View& view, std::uint32_t index) {
  const Object& o = level_.scene.objects[index];
  const Material& m = level_.scene.materials[o.material];
  const Look& look = level_.looks[o.material];
  const glm::dmat4& world = level_.worlds[index];
  program.set("world", world);
  program.set("normalMatrix", normalMatrix(world));
  program.set("worldMirror", glm::determinant(glm::dmat3(world)) < 0.0 ? -1.0 : 1.0);
  program.set("objectSpaceNormals", int(look.objectSpaceNormals));

  const std::array<Texture, 6> textures = texturesOf(m, look);
  std::array<int, 6> uvSets{};
  std::array<glm::mat3, 6> transforms;
  for (std::size_t unit = 0; unit < textures.size(); ++unit) {
    const Encoding encoding = unit == 0 || unit == 2 || unit == 4 ? Encoding::Srgb : Encoding::Linear;
    bind(int(unit), textures[unit], encoding, unit == 3 ? flat_ : white_);
    uvSets[unit] = textures[unit].uvSet;
    transforms[unit] = textures[unit].transform;
  }
  const bool mapped = hasMap(level_, maps_, view, index), opened = hasOpenness(level_, maps_, index);
  for (const auto& [unit, name] : {std::pair(6, mapped ? lightMaps_[o.map] : white_), {7, opened ? aoMaps_[o.map] : white_}}) {
    gl_.ActiveTexture(GLenum(GL_TEXTURE0 + unit));
    gl_.BindTexture(GL_TEXTURE_2D, name);
    gl_.BindSampler(GLuint(unit), samplerFor(Wrap::Clamp, Wrap::Clamp));
  }
  program.set("uvSet", uvSets);
  program.set("uvTransform", transforms);
  program.set("baseColorFactor", glm::dvec4(m.baseColor));
  program.set("metallicFactor", double(m.metallic));
  program.set("roughnessFactor", double(look.roughness));
  program.set("specularFactor", glm::dvec3(look.specular));
  program.set("dullByRoughness", int(look.dullByRoughness));
  program.set("emissionFactor", glm::dvec3(m.emission));
  program.set("normalScale", double(look.normalScale));
  program.set("occlusionStrength", double(look.occlusionStrength));
  program.set("alphaCutoff", m.alpha == Material::Alpha::Mask ? double(m.alphaCutoff) : -1.0);
  program.set("lightMapScale", mapped ? maps_.scale(o.map) : 0.0);
  program.set("useAoMap", int(opened));

  if (m.doubleSided)
    gl_.Disable(GL_CULL_FACE);
  else
    gl_.Enable(GL_CULL_FACE);
  gl_.BindVertexArray(array_);
  gl_.DrawElements(GL_TRIANGLES, GLsizei(3 * o.triangleCount), GL_UNSIGNED_INT,
                   reinterpret_cast<const void*>(std::size_t(o.firstTriangle) * sizeof(glm::uvec3)));
}

}  // namespace lmc::shaders
