#include "shaders/reference.h"

#include <algorithm>
#include <cmath>

#include "libscene/error.h"
#include "shaders/gl_level.h"

namespace lmc::shaders {

namespace {

constexpr int kGBufferTargets = 6;   // Diffuse to Emission
constexpr double kWidestCone = 0.5;  // cosine; a spot that opens wider is drawn by its sphere, for a cone grows without end

struct Buffers {
  int width, height;
  std::array<GLuint, kTargetNames.size()> textures{};  ///< by Target
  GLuint depth = 0, geometry = 0, light = 0, screenAo = 0, radiance = 0, picture = 0;
};

/// The camera as the shaders want it.
struct Lens {
  glm::dmat4 viewProjection;
  glm::dvec3 position, forward, right, up;
};

Lens lensOf(const Scene& scene, const View& view) {
  const Camera& c = view.camera;
  const double tangent = std::tan(0.5 * c.verticalFov_rad), aspect = double(view.width) / view.height, near_m = nearPlane_m(scene, c);
  glm::dmat4 projection(0.0);
  projection[0][0] = 1.0 / (tangent * aspect);
  projection[1][1] = 1.0 / tangent;
  projection[2] = {0.0, 0.0, -1.0, -1.0};  // without a far plane: the volumes of lights may reach far behind the level
  projection[3] = {0.0, 0.0, -2.0 * near_m, 0.0};
  const glm::dmat3 turn = glm::transpose(c.axes);
  glm::dmat4 toCamera(turn);
  toCamera[3] = glm::dvec4(-(turn * c.position_m), 1.0);
  return {projection * toCamera, c.position_m, -c.axes[2], tangent * aspect * c.axes[0], tangent * c.axes[1]};
}

/// All that a light reaches; the whole screen where that has no end.
struct Volume {
  const GlMesh* mesh;
  bool bounded = true;
  glm::dmat4 toWorld{1.0};
};

Volume volumeOf(const GlLevel& level, const ShadedLight& shaded, const Lens& lens, bool wanted) {
  const Light& light = shaded.light;
  const double range = light.classic ? light.classic->range : light.range_m;
  // An ambient term has no attenuation: it would end at the border of the volume, for all to see.
  if (!wanted || !(range > 0.0) || shaded.ambient != Rgb(0.0f)) return {&level.screen(), false, glm::inverse(lens.viewProjection)};
  Volume out{&level.sphere()};
  out.toWorld[3] = glm::dvec4(light.position_m, 1.0);
  if (light.kind == Light::Kind::Point || light.cosOuter < kWidestCone) {
    for (int k = 0; k < 3; ++k) out.toWorld[k] *= range;
    return out;
  }
  out.mesh = &level.cone();
  const glm::dvec3 back = -light.direction, aside = std::abs(back.y) > 0.9 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const glm::dvec3 right = glm::normalize(glm::cross(aside, back));
  const double radius = range * std::sqrt(1.0 - light.cosOuter * light.cosOuter) / light.cosOuter;
  out.toWorld[0] = glm::dvec4(radius * right, 0.0);
  out.toWorld[1] = glm::dvec4(radius * glm::cross(back, right), 0.0);
  out.toWorld[2] = glm::dvec4(range * back, 0.0);
  return out;
}

Pass passOf(Light::Kind kind) {
  return kind == Light::Kind::Directional ? Pass::Directional : kind == Light::Kind::Point ? Pass::Point : Pass::Spot;
}

bool isLit(const View& view, Light::Kind kind) {
  return kind == Light::Kind::Directional ? view.directional : kind == Light::Kind::Point ? view.point : view.spot;
}

}  // namespace

struct Reference::State {
  State(const ShadingLevel& l, const LevelMaps& m) : level(l), maps(m), meshes(gl, l, m) {}

  const ShadingLevel& level;
  const LevelMaps& maps;
  GlContext gl;
  GlLevel meshes;
  std::map<std::pair<std::size_t, std::filesystem::path>, GlProgram> programs;  ///< by pass and the user's folder
  int lightsDrawn = 0;                                                          ///< of the last picture

  const GlProgram& use(Pass, const ShaderChoice&);
  Buffers makeBuffers(int width, int height);
  void freeBuffers(Buffers&);
  GLuint framebuffer(const Buffers&, std::span<const Target>, bool withDepth);
  void bindTargets(const Buffers&, std::span<const Target>);
  void setLens(const GlProgram&, const Lens&, const Buffers&);
  void drawScreen();

  void geometry(const View&, const ShaderChoice&, const Lens&, const Buffers&);
  void lights(const View&, const ShaderChoice&, const Lens&, const Buffers&);
  void light(const ShadedLight&, const View&, const ShaderChoice&, const Lens&, const Buffers&);
  void screenAo(const View&, const ShaderChoice&, const Lens&, const Buffers&);
  void composite(const View&, const ShaderChoice&, const Lens&, const Buffers&);
  void toneMap(const View&, const ShaderChoice&, double exposure, const Buffers&);
  Image<glm::vec4> read(GLuint framebuffer, int attachment, const Buffers&);
};

const GlProgram& Reference::State::use(Pass pass, const ShaderChoice& choice) {
  const auto index = std::size_t(pass);
  const std::filesystem::path folder = choice.own[index] ? choice.folder : std::filesystem::path();
  auto it = programs.find({index, folder});
  if (it == programs.end()) it = programs.emplace(std::pair(index, folder), GlProgram(gl, kPasses[index], folder)).first;
  it->second.use();
  return it->second;
}

GLuint Reference::State::framebuffer(const Buffers& b, std::span<const Target> targets, bool withDepth) {
  GLuint out = 0;
  gl.GenFramebuffers(1, &out);
  gl.BindFramebuffer(GL_FRAMEBUFFER, out);
  std::vector<GLenum> attachments;
  for (const Target t : targets) {
    attachments.push_back(GLenum(GL_COLOR_ATTACHMENT0 + attachments.size()));
    gl.FramebufferTexture2D(GL_FRAMEBUFFER, attachments.back(), GL_TEXTURE_2D, b.textures[std::size_t(t)], 0);
  }
  if (withDepth) gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, b.depth, 0);
  gl.DrawBuffers(GLsizei(attachments.size()), attachments.data());
  if (gl.CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    throw Error(Exit::Unsupported, "shaders", "", "GL cannot draw into buffers of 32-bit floats", "LMC_OSMESA");
  return out;
}

Buffers Reference::State::makeBuffers(int width, int height) {
  GLint most = 0;
  gl.GetIntegerv(GL_MAX_TEXTURE_SIZE, &most);
  if (width > most || height > most)
    throw Error(Exit::Limit, "shaders", "", "the picture is larger than GL can draw", "LMC_TEXTURE_TOO_LARGE");
  Buffers b{width, height};
  const auto texture = [&](GLint inside, GLenum from) {
    GLuint name = 0;
    gl.GenTextures(1, &name);
    gl.BindTexture(GL_TEXTURE_2D, name);
    gl.TexImage2D(GL_TEXTURE_2D, 0, inside, width, height, 0, from, GL_FLOAT, nullptr);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return name;
  };
  gl.ActiveTexture(GL_TEXTURE0);
  for (GLuint& t : b.textures) t = texture(GL_RGBA32F, GL_RGBA);
  b.depth = texture(GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT);
  gl.check("making the buffers");
  const std::array geometryTargets{Target::Diffuse, Target::Specular, Target::Normal, Target::Depth, Target::Baked, Target::Emission};
  static_assert(geometryTargets.size() == kGBufferTargets);
  b.geometry = framebuffer(b, geometryTargets, true);
  b.light = framebuffer(b, std::array{Target::AmbientLight, Target::DiffuseLight, Target::SpecularLight}, true);
  b.screenAo = framebuffer(b, std::array{Target::ScreenAo}, false);
  b.radiance = framebuffer(b, std::array{Target::Radiance}, false);
  b.picture = framebuffer(b, std::array{Target::Picture}, false);
  gl.Viewport(0, 0, width, height);
  return b;
}

void Reference::State::freeBuffers(Buffers& b) {
  for (const GLuint framebuffer : {b.geometry, b.light, b.screenAo, b.radiance, b.picture}) gl.DeleteFramebuffers(1, &framebuffer);
  gl.DeleteTextures(GLsizei(b.textures.size()), b.textures.data());
  gl.DeleteTextures(1, &b.depth);
}

void Reference::State::bindTargets(const Buffers& b, std::span<const Target> targets) {
  for (std::size_t unit = 0; unit < targets.size(); ++unit) {
    gl.ActiveTexture(GLenum(GL_TEXTURE0 + unit));
    gl.BindTexture(GL_TEXTURE_2D, b.textures[std::size_t(targets[unit])]);
    gl.BindSampler(GLuint(unit), 0);
  }
}

void Reference::State::setLens(const GlProgram& program, const Lens& lens, const Buffers& b) {
  program.set("viewProjection", lens.viewProjection);
  program.set("cameraPosition", lens.position);
  program.set("cameraForward", lens.forward);
  program.set("cameraRight", lens.right);
  program.set("cameraUp", lens.up);
  program.set("pixelCount", glm::dvec2(b.width, b.height));
  int unit = 0;
  for (const char* name : {"diffuseBuffer", "specularBuffer", "normalBuffer", "depthBuffer", "bakedBuffer", "emissionBuffer",
                           "ambientBuffer", "lightBuffer", "shineBuffer", "ssaoBuffer"})
    program.set(name, unit++);
}

void Reference::State::drawScreen() {
  gl.BindVertexArray(meshes.nothing().array);
  gl.DrawArrays(GL_TRIANGLES, 0, 3);
}

void Reference::State::geometry(const View& view, const ShaderChoice& choice, const Lens& lens, const Buffers& b) {
  gl.BindFramebuffer(GL_FRAMEBUFFER, b.geometry);
  const float nothing[4] = {0, 0, 0, 0}, farthest = 1.0f;
  gl.Disable(GL_BLEND);
  gl.Enable(GL_DEPTH_TEST);
  gl.DepthFunc(GL_LESS);
  gl.DepthMask(GL_TRUE);
  gl.CullFace(GL_BACK);
  for (int k = 0; k < kGBufferTargets; ++k) gl.ClearBufferfv(GL_COLOR, k, nothing);
  gl.ClearBufferfv(GL_DEPTH, 0, &farthest);
  for (const Pass pass : {Pass::GBuffers, Pass::GBuffersBump}) {
    const GlProgram* program = nullptr;
    for (std::uint32_t o = 0; o < level.scene.objects.size(); ++o) {
      if (!isDrawn(level, view, o) || hasNormalMap(level, view, o) != (pass == Pass::GBuffersBump)) continue;
      if (!program) {
        program = &use(pass, choice);
        setLens(*program, lens, b);
        int unit = 0;
        for (const char* name : {"baseColorTexture", "roughnessTexture", "specularTexture", "normalTexture", "emissionTexture",
                                 "occlusionTexture", "lightMap", "aoMap"})
          program->set(name, unit++);
      }
      meshes.draw(*program, view, o);
    }
  }
}

void Reference::State::lights(const View& view, const ShaderChoice& choice, const Lens& lens, const Buffers& b) {
  gl.BindFramebuffer(GL_FRAMEBUFFER, b.light);
  const glm::vec4 ambient(view.ambient ? level.scene.ambient : Rgb(0.0f), 0.0f), nothing(0.0f);
  gl.ClearBufferfv(GL_COLOR, 0, &ambient.x);
  gl.ClearBufferfv(GL_COLOR, 1, &nothing.x);
  gl.ClearBufferfv(GL_COLOR, 2, &nothing.x);
  gl.DepthMask(GL_FALSE);
  gl.Disable(GL_DEPTH_TEST);
  gl.Disable(GL_CULL_FACE);
  bindTargets(b, std::array{Target::Diffuse, Target::Specular, Target::Normal, Target::Depth, Target::Baked});
  if (view.lightMapPass) {
    setLens(use(Pass::LightMap, choice), lens, b);
    drawScreen();
  }
  gl.Enable(GL_BLEND);
  gl.BlendFunc(GL_ONE, GL_ONE);
  lightsDrawn = 0;
  for (const ShadedLight& l : level.lights) {
    // What a user's shader makes of it is to be seen.
    if (!isLit(view, l.light.kind) || (choice.folder.empty() && addsNothing(level, maps, view, l))) continue;
    light(l, view, choice, lens, b);
    ++lightsDrawn;
  }
  gl.Disable(GL_BLEND);
  gl.Disable(GL_DEPTH_TEST);
  gl.Disable(GL_CULL_FACE);
}

void Reference::State::light(const ShadedLight& shaded, const View& view, const ShaderChoice& choice, const Lens& lens, const Buffers& b) {
  const Light& light = shaded.light;
  const GlProgram& program = use(passOf(light.kind), choice);
  setLens(program, lens, b);
  program.set("lightPosition", light.position_m);
  program.set("lightDirection", light.direction);
  program.set("lightAmbient", glm::dvec3(shaded.ambient));
  program.set("lightDiffuse", glm::dvec3(light.intensity));
  program.set("lightSpecular", glm::dvec3(shaded.specular));
  program.set("lightSpecularIntensity", shaded.specularIntensity);
  program.set("lightSpecularPower", shaded.specularPower);
  program.set("lightPhysical", int(!light.classic));
  program.set("lightBaked", int(shaded.baked));
  const ClassicAttenuation a = light.classic.value_or(ClassicAttenuation{});
  program.set("lightAttenuation", glm::dvec3(a.constant, a.linear, a.quadratic));
  program.set("lightRange", light.classic ? a.range : light.range_m);
  program.set("lightRangePower", a.power);
  program.set("lightCone", glm::dvec2(light.cosInner, light.cosOuter));
  if (light.kind == Light::Kind::Directional) {
    drawScreen();
    return;
  }
  const Volume volume = volumeOf(meshes, shaded, lens, view.volumes);
  program.set("volume", volume.toWorld);
  if (volume.bounded) {
    // The backs of the volume where they lie behind what was drawn: right from outside and from inside.
    gl.Enable(GL_DEPTH_TEST);
    gl.DepthFunc(GL_GEQUAL);
    gl.Enable(GL_CULL_FACE);
    gl.CullFace(GL_FRONT);
  }
  gl.BindVertexArray(volume.mesh->array);
  gl.DrawElements(GL_TRIANGLES, volume.mesh->count, GL_UNSIGNED_INT, nullptr);
  gl.Disable(GL_DEPTH_TEST);
  gl.Disable(GL_CULL_FACE);
}

void Reference::State::screenAo(const View& view, const ShaderChoice& choice, const Lens& lens, const Buffers& b) {
  gl.BindFramebuffer(GL_FRAMEBUFFER, b.screenAo);
  const float open[4] = {1, 1, 1, 1};
  gl.ClearBufferfv(GL_COLOR, 0, open);
  if (!view.screenAo) return;
  const GlProgram& program = use(Pass::Ssao, choice);
  setLens(program, lens, b);
  program.set("ssaoRadius", screenAoRadius_m(level.scene));
  drawScreen();
}

void Reference::State::composite(const View& view, const ShaderChoice& choice, const Lens& lens, const Buffers& b) {
  gl.BindFramebuffer(GL_FRAMEBUFFER, b.radiance);
  bindTargets(b, std::array{Target::Diffuse, Target::Specular, Target::Normal, Target::Depth, Target::Baked, Target::Emission,
                            Target::AmbientLight, Target::DiffuseLight, Target::SpecularLight, Target::ScreenAo});
  const GlProgram& program = use(Pass::Composite, choice);
  setLens(program, lens, b);
  program.set("backgroundRadiance", glm::dvec3(level.scene.sky));
  program.set("useBakedAo", int(view.bakedAo));
  program.set("useScreenAo", int(view.screenAo));
  program.set("ssaoRadius", screenAoRadius_m(level.scene));
  drawScreen();
}

void Reference::State::toneMap(const View& view, const ShaderChoice& choice, double exposure, const Buffers& b) {
  gl.BindFramebuffer(GL_FRAMEBUFFER, b.picture);
  bindTargets(b, std::array{Target::Radiance});
  const GlProgram& program = use(Pass::ToneMap, choice);
  program.set("radianceBuffer", 0);
  program.set("exposure", exposure);
  program.set("toneCurve", int(view.toneCurve));
  program.set("encode", int(view.encode));
  drawScreen();
}

Image<glm::vec4> Reference::State::read(GLuint framebuffer, int attachment, const Buffers& b) {
  Image<glm::vec4> out(b.width, b.height), upsideDown(b.width, b.height);
  gl.BindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  gl.ReadBuffer(GLenum(GL_COLOR_ATTACHMENT0 + attachment));
  gl.ReadPixels(0, 0, b.width, b.height, GL_RGBA, GL_FLOAT, &upsideDown.pixels[0].x);
  for (int y = 0; y < b.height; ++y) std::copy_n(&upsideDown.at(0, b.height - 1 - y), b.width, &out.at(0, y));
  return out;
}

Reference::Reference(const ShadingLevel& level, const LevelMaps& maps) : state_(std::make_unique<State>(level, maps)) {}
Reference::~Reference() = default;

Frame Reference::render(const View& view, const ShaderChoice& choice) {
  State& s = *state_;
  const Lens lens = lensOf(s.level.scene, view);
  Buffers b = s.makeBuffers(view.width, view.height);
  s.geometry(view, choice, lens, b);
  s.lights(view, choice, lens, b);
  s.screenAo(view, choice, lens, b);
  s.composite(view, choice, lens, b);
  Frame out;
  out.width = view.width;
  out.height = view.height;
  out.lightsDrawn = s.lightsDrawn;
  out[Target::Radiance] = s.read(b.radiance, 0, b);
  out.exposure = view.exposure > 0.0 ? view.exposure : exposureFor(out[Target::Radiance]);
  s.toneMap(view, choice, out.exposure, b);
  const auto keep = [&](Target t, GLuint framebuffer, int attachment) {
    if (!view.only || *view.only == t) out[t] = s.read(framebuffer, attachment, b);
  };
  keep(Target::Picture, b.picture, 0);
  for (int k = 0; k < kGBufferTargets; ++k) keep(Target(k), b.geometry, k);
  keep(Target::ScreenAo, b.screenAo, 0);
  for (int k = 0; k < 3; ++k) keep(Target(int(Target::AmbientLight) + k), b.light, k);
  s.freeBuffers(b);
  s.gl.check("drawing");
  return out;
}

}  // namespace lmc::shaders
