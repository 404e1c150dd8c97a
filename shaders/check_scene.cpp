#include "shaders/check_scene.h"

#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

#include "libscene/constants.h"

namespace lmc::shaders {

namespace {

constexpr int kPictureSide = 32;

/// value(u, v) in [0, 1]^4 as a picture.
template <class F>
Image<glm::u8vec4> picture(const F& value) {
  Image<glm::u8vec4> out(kPictureSide, kPictureSide);
  for (int y = 0; y < kPictureSide; ++y)
    for (int x = 0; x < kPictureSide; ++x)
      out.at(x, y) = glm::u8vec4(glm::round(255.0 * glm::clamp(value((x + 0.5) / kPictureSide, (y + 0.5) / kPictureSide), 0.0, 1.0)));
  return out;
}

double wave(double x) { return 0.5 + 0.5 * std::sin(2.0 * kPi * x); }

class Builder {
 public:
  CheckScene build();

 private:
  enum Pictures : std::uint32_t { kColour, kNormals, kShine, kSurface, kHoles };
  void pictures();
  std::uint32_t material(const Material&, const Look&);
  static Texture use(Pictures p) {
    Texture t;
    t.image = p;
    return t;
  }
  void materials();
  void begin(std::uint32_t material, const glm::dmat4& world, bool marked);
  void vertex(const glm::dvec3& position, const glm::dvec3& normal, const glm::dvec4& tangent, const glm::dvec2& uv);
  void end();
  void ball(std::uint32_t material, const glm::dmat4& world, bool mirroredUvs);
  void panel(std::uint32_t material, const glm::dmat4& world, bool marked);
  void maps();
  void lights();

  CheckScene out_;
  std::uint32_t plain_ = 0, bumpy_ = 0, objectSpace_ = 0, floor_ = 0, bothSides_ = 0, holes_ = 0, glowing_ = 0;
};

void Builder::pictures() {
  std::vector<Image<glm::u8vec4>>& images = out_.level.scene.images;
  images.push_back(picture(
      [](double u, double v) { return glm::dvec4(0.3 + 0.6 * wave(u), 0.35 + 0.4 * wave(v + 0.3), 0.25 + 0.3 * wave(u + v), 1.0); }));
  images.push_back(picture([](double u, double v) {
    // Slopes that no mirror image repeats, so that a sign shows wherever it is.
    const glm::dvec3 n = glm::normalize(glm::dvec3(0.5 * std::sin(4.0 * kPi * u) + 0.15, 0.5 * std::cos(6.0 * kPi * v) - 0.25, 1.0));
    return glm::dvec4(0.5 * n + 0.5, 1.0);
  }));
  images.push_back(picture([](double u, double v) { return glm::dvec4(0.2 + 0.7 * wave(2.0 * u), 0.5, 0.1 + 0.6 * wave(2.0 * v), 1.0); }));
  images.push_back(
      picture([](double u, double v) { return glm::dvec4(0.3 + 0.5 * wave(u), 0.4 + 0.5 * wave(v), 0.4 * wave(u - v), 1.0); }));
  images.push_back(picture([](double u, double v) { return glm::dvec4(0.8, 0.7, 0.4, wave(2.0 * u) * wave(2.0 * v) * 1.6); }));
}

std::uint32_t Builder::material(const Material& m, const Look& look) {
  out_.level.scene.materials.push_back(m);
  out_.level.looks.push_back(look);
  return std::uint32_t(out_.level.looks.size() - 1);
}

void Builder::materials() {
  Material m;
  m.baseColorTexture = use(kColour);
  m.metallic = 0.5f;
  Look look;
  look.roughness = 0.7f;
  look.roughnessTexture = look.occlusionTexture = use(kSurface);
  look.specularTexture = use(kShine);
  look.specular = Rgb(0.6f);
  look.occlusionStrength = 0.8f;
  plain_ = floor_ = material(m, look);
  look.normalTexture = use(kNormals);
  look.normalScale = 1.3f;
  bumpy_ = material(m, look);
  look.objectSpaceNormals = true;
  objectSpace_ = material(m, look);
  look.normalTexture = {};
  m.doubleSided = true;
  bothSides_ = material(m, look);
  m.emission = Rgb(0.3f, 0.15f, 0.5f);
  m.emissionTexture = use(kColour);
  glowing_ = material(m, look);
  m.emission = Rgb(0.0f);
  m.baseColorTexture = use(kHoles);
  m.alpha = Material::Alpha::Mask;
  holes_ = material(m, look);
}

void Builder::begin(std::uint32_t material, const glm::dmat4& world, bool marked) {
  Scene& s = out_.level.scene;
  Object o;
  o.node = std::uint32_t(s.objects.size());
  o.path = "/check " + std::to_string(o.node);
  o.material = material;
  o.firstTriangle = std::uint32_t(s.triangles.size());
  o.firstVertex = std::uint32_t(s.positions_m.size());
  o.mirrored = glm::determinant(glm::dmat3(world)) < 0.0;
  s.objects.push_back(o);
  out_.level.worlds.push_back(world);
  out_.level.marked.push_back(marked);
}

void Builder::vertex(const glm::dvec3& position, const glm::dvec3& normal, const glm::dvec4& tangent, const glm::dvec2& uv) {
  Scene& s = out_.level.scene;
  const glm::dmat4& world = out_.level.worlds.back();
  const glm::vec3 p(world * glm::dvec4(position, 1.0));
  out_.level.positions_m.emplace_back(position);
  out_.level.normals.emplace_back(normal);
  out_.level.tangents.emplace_back(tangent);
  s.positions_m.push_back(p);
  s.normals.emplace_back(glm::normalize(normalMatrix(world) * normal));
  s.uv0.emplace_back(uv);
  s.mapUv.emplace_back(uv);
  for (int k = 0; k < 3; ++k) s.extent_m = std::max(s.extent_m, std::abs(p[k]));
}

void Builder::end() {
  Scene& s = out_.level.scene;
  Object& o = s.objects.back();
  o.triangleCount = std::uint32_t(s.triangles.size()) - o.firstTriangle;
  o.vertexCount = std::uint32_t(s.positions_m.size()) - o.firstVertex;
  if (o.mirrored)
    for (std::uint32_t t = o.firstTriangle; t < s.triangles.size(); ++t) std::swap(s.triangles[t].y, s.triangles[t].z);
  s.triangleObject.resize(s.triangles.size(), std::uint32_t(s.objects.size() - 1));
}

/// The unit ball; u runs eastwards, or westwards where UVs are mirrored; green of a normal map points to the north.
void Builder::ball(std::uint32_t material, const glm::dmat4& world, bool mirroredUvs) {
  constexpr int kAround = 24, kDown = 12;
  const auto first = std::uint32_t(out_.level.scene.positions_m.size());
  begin(material, world, false);
  for (int j = 0; j <= kDown; ++j)
    for (int i = 0; i <= kAround; ++i) {
      const double theta = kPi * j / kDown, phi = 2.0 * kPi * i / kAround;
      const glm::dvec3 n(std::sin(theta) * std::sin(phi), std::cos(theta), std::sin(theta) * std::cos(phi));
      const glm::dvec3 east(std::cos(phi), 0.0, -std::sin(phi));  // cross(n, east) points to the north
      const double u = 3.0 * i / kAround, sign = mirroredUvs ? -1.0 : 1.0;
      vertex(n, n, glm::dvec4(sign * east, sign), {sign * u, 1.5 * j / kDown});
    }
  for (int j = 0; j < kDown; ++j)
    for (int i = 0; i < kAround; ++i) {
      const std::uint32_t a = first + std::uint32_t(j * (kAround + 1) + i), b = a + kAround + 1;
      if (j > 0) out_.level.scene.triangles.emplace_back(a, b, a + 1);
      if (j + 1 < kDown) out_.level.scene.triangles.emplace_back(a + 1, b, b + 1);
    }
  end();
}

/// The square from -1 to 1, its front to +Z.
void Builder::panel(std::uint32_t material, const glm::dmat4& world, bool marked) {
  const auto first = std::uint32_t(out_.level.scene.positions_m.size());
  begin(material, world, marked);
  for (const glm::dvec2 c : {glm::dvec2(-1, -1), glm::dvec2(1, -1), glm::dvec2(1, 1), glm::dvec2(-1, 1)})
    vertex({c, 0.0}, {0, 0, 1}, {1, 0, 0, 1}, {0.5 + 0.5 * c.x, 0.5 - 0.5 * c.y});
  out_.level.scene.triangles.emplace_back(first, first + 1, first + 2);
  out_.level.scene.triangles.emplace_back(first, first + 2, first + 3);
  end();
}

void Builder::maps() {
  Image<Rgb> light(kPictureSide, kPictureSide);
  Image<float> openness(kPictureSide, kPictureSide);
  for (int y = 0; y < kPictureSide; ++y)
    for (int x = 0; x < kPictureSide; ++x) {
      const double u = (x + 0.5) / kPictureSide, v = (y + 0.5) / kPictureSide;
      light.at(x, y) = Rgb(0.4 + 1.6 * u, 0.3 + v, 1.4 - u * v);
      openness.at(x, y) = float(0.35 + 0.6 * wave(u) * wave(v));
    }
  out_.maps.illuminance.push_back(light);
  out_.maps.scales.push_back(4.0f);
  out_.maps.openness.push_back(openness);
}

void Builder::lights() {
  const auto add = [&](Light::Kind kind, glm::dvec3 position_m, glm::dvec3 direction, Rgb intensity, double range_m, bool classic) {
    ShadedLight& l = out_.level.lights.emplace_back();
    l.light.kind = kind;
    l.light.position_m = position_m;
    l.light.direction = glm::normalize(direction);
    l.light.intensity = l.specular = intensity;
    l.light.range_m = range_m;
    l.light.cosInner = std::cos(0.2);
    l.light.cosOuter = std::cos(0.5);
    if (!classic) return &l;
    l.specularPower = 6.0;
    l.specularIntensity = 0.8;
    l.light.classic.emplace();
    if (range_m > 0.0) l.light.classic = ClassicAttenuation{1.0, 2.0 / range_m, 1.0 / (range_m * range_m), range_m, 3.0};
    return &l;
  };
  using Kind = Light::Kind;
  const glm::dvec3 down(0, -1, 0);
  ShadedLight* sun = add(Kind::Directional, {}, {-0.8, -1.0, -0.3}, Rgb(0.25f, 0.22f, 0.18f), 0.0, true);
  sun->ambient = Rgb(0.06f, 0.08f, 0.1f);
  add(Kind::Directional, {}, {0.9, -0.5, -0.1}, Rgb(0.4f, 0.5f, 0.7f), 0.0, false);
  add(Kind::Point, {-1.8, 0.9, 1.8}, down, Rgb(1.2f, 0.7f, 0.4f), 4.0, true);
  add(Kind::Point, {0.6, 1.6, 1.6}, down, Rgb(2.0f, 3.0f, 2.0f), 5.0, false);
  add(Kind::Point, {2.9, 0.4, -0.8}, down, Rgb(1.5f, 0.4f, 1.5f), 0.0, false);
  add(Kind::Spot, {-2.4, 2.4, 1.2}, {0.3, -1.0, -0.4}, Rgb(0.9f, 1.0f, 0.7f), 6.0, true);
  add(Kind::Spot, {2.2, 2.2, 2.2}, {-0.3, -1.0, -0.9}, Rgb(9.0f, 7.0f, 4.0f), 7.0, false);
  add(Kind::Point, {0.0, 1.2, -0.5}, down, Rgb(1.0f), 0.0, false)->baked = true;
  add(Kind::Directional, {}, {0.2, -1.0, 0.4}, Rgb(0.3f), 0.0, false)->baked = true;
  add(Kind::Spot, {0.5, 3.0, 0.5}, {0.0, -1.0, 0.1}, Rgb(5.0f), 0.0, false)->baked = true;
}

CheckScene Builder::build() {
  pictures();
  materials();
  const auto at = [](double x, double y, double z) { return glm::translate(glm::dmat4(1.0), glm::dvec3(x, y, z)); };
  const auto turned = [](const glm::dmat4& m, double angle_rad, glm::dvec3 axis) {
    return glm::rotate(m, angle_rad, glm::normalize(axis));
  };
  const auto scaled = [](const glm::dmat4& m, double x, double y, double z) { return glm::scale(m, glm::dvec3(x, y, z)); };
  panel(floor_, scaled(turned(at(0.0, -1.0, 0.0), -kPi / 2, {1, 0, 0}), 4.0, 3.0, 1.0), true);
  panel(plain_, scaled(at(0.0, 1.0, -3.0), 4.0, 2.0, 1.0), false);
  ball(bumpy_, scaled(at(-2.7, -0.2, 0.2), 0.8, 0.8, 0.8), false);
  ball(bumpy_, scaled(at(-0.9, -0.2, 0.6), 0.8, 0.8, 0.8), true);
  ball(bumpy_, scaled(at(0.9, -0.2, 0.2), -0.8, 0.8, 0.8), false);
  ball(objectSpace_, turned(scaled(at(2.7, -0.3, 0.6), 0.7, 0.7, 0.7), 0.7, {1, 2, 0}), false);
  ball(plain_, turned(scaled(turned(at(-2.0, 1.5, -1.0), 0.6, {0, 0, 1}), 0.9, 0.3, 0.6), 0.5, {1, 0, 1}), false);
  ball(bumpy_, turned(scaled(turned(at(0.2, 1.5, -1.4), -0.5, {0, 0, 1}), 0.4, 0.9, 0.5), 0.4, {0, 1, 1}), true);
  panel(bothSides_, scaled(turned(at(2.2, 1.4, -1.2), kPi + 0.4, {0, 1, 0}), 0.6, 0.6, 1.0), false);
  panel(holes_, scaled(turned(at(-3.2, 1.2, -1.5), 0.5, {0, 1, 0}), 0.6, 0.6, 1.0), false);
  panel(glowing_, scaled(turned(at(3.4, 1.2, -1.5), -0.5, {0, 1, 0}), 0.5, 0.5, 1.0), false);
  maps();
  lights();
  out_.level.scene.file = "check scene";
  out_.level.scene.ambient = Rgb(0.12f, 0.1f, 0.08f);
  out_.level.scene.sky = Rgb(0.05f, 0.1f, 0.2f);
  out_.view.camera = cameraAt({0.4, 1.2, 6.5}, {0.0, 0.3, -0.5}, 0.75);
  out_.view.width = 192;
  out_.view.height = 108;
  out_.view.exposure = 1.2;
  return std::move(out_);
}

}  // namespace

CheckScene checkScene() { return Builder().build(); }

}  // namespace lmc::shaders
