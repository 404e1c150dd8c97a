#include "shaders/oracle.h"

#include <algorithm>
#include <cmath>

#include "libscene/constants.h"
#include "libscene/parallel.h"
#include "shaders/formulas.h"
#include "shaders/raster.h"
#include "shaders/sampling.h"

namespace lmc::shaders {

namespace {

/// What a fragment's corners say of it.
struct Corners {
  const ShadingLevel& level;
  std::uint32_t object;
  glm::uvec3 vertices;
  const Fragment& fragment;

  Corners(const ShadingLevel& l, const Fragment& f)
      : level(l), object(l.scene.triangleObject[f.triangle]), vertices(l.scene.triangles[f.triangle]), fragment(f) {}

  /// value(vertex), interpolated.
  template <class F>
  auto mean(const F& value) const {
    return fragment.bary.x * value(vertices.x) + fragment.bary.y * value(vertices.y) + fragment.bary.z * value(vertices.z);
  }
  glm::dvec2 uv(int set) const {
    const Scene& s = level.scene;
    const std::vector<glm::vec2>& uvs = set == 0 || s.uv1.empty() ? s.uv0 : s.uv1;
    return mean([&](std::uint32_t v) { return glm::dvec2(uvs[v]); });
  }
  glm::dvec2 mapUv() const {
    return mean([&](std::uint32_t v) { return glm::dvec2(level.scene.mapUv[v]); });
  }
  glm::dvec4 texture(const Texture& t, Encoding encoding) const { return sample(level.scene, t, uv(t.uvSet), encoding); }
  const Material& material() const { return level.scene.materials[level.scene.objects[object].material]; }
  const Look& look() const { return level.looks[level.scene.objects[object].material]; }

  glm::dvec4 baseColor() const {
    const glm::dvec4 own = glm::dvec4(material().baseColor) * texture(material().baseColorTexture, Encoding::Srgb);
    const std::vector<glm::vec4>& colors = level.scene.colors;
    return colors.empty() ? own : own * mean([&](std::uint32_t v) { return glm::dvec4(colors[v]); });
  }
};

Image<Fragment> fragmentsOf(const ShadingLevel& level, const View& view) {
  return rasterise(level, view, [&](const Fragment& f) {
    const Corners c(level, f);
    return c.material().alpha != Material::Alpha::Mask || c.baseColor().a >= double(c.material().alphaCutoff);
  });
}

class Oracle {
 public:
  Oracle(const ShadingLevel& level, const LevelMaps& maps, const View& view, Slip slip)
      : level_(level), maps_(maps), view_(view), slip_(slip) {
    frame_.width = view.width;
    frame_.height = view.height;
    for (Image<glm::vec4>& target : frame_.targets) target = Image<glm::vec4>(view.width, view.height, glm::vec4(0.0f));
  }
  Frame render(const Run&);

 private:
  glm::dvec3 normalOf(const Corners&) const;
  double opennessOf(const Corners&) const;
  glm::dvec3 illuminanceOf(const Corners&) const;
  void geometry(const Fragment&, int x, int y);
  void lights(int x, int y);
  double screenOpenness(int x, int y) const;
  double smoothedOpenness(int x, int y) const;
  void composite(int x, int y);
  void toneMap(int x, int y);
  glm::vec4& at(Target t, int x, int y) { return frame_[t].at(x, y); }
  glm::dvec4 value(Target t, int x, int y) const { return glm::dvec4(frame_[t].at(x, y)); }
  bool isSurface(int x, int y) const { return frame_[Target::Depth].at(x, y).x > 0.0f; }
  glm::dvec3 positionOf(int x, int y) const { return view_.camera.position_m + value(Target::Depth, x, y).x * pixelAxis(view_, x, y); }
  glm::dvec3 normalAt(int x, int y) const { return glm::normalize(colourToNormal(glm::dvec3(value(Target::Normal, x, y)))); }

  const ShadingLevel& level_;
  const LevelMaps& maps_;
  const View& view_;
  const Slip slip_;
  Frame frame_;
};

glm::dvec3 Oracle::normalOf(const Corners& c) const {
  const glm::dmat4& world = level_.worlds[c.object];
  const glm::dmat3 toWorld = slip_ == Slip::NormalByWorldMatrix ? glm::dmat3(world) : normalMatrix(world);
  const auto plain = [&] {
    return glm::normalize(c.mean([&](std::uint32_t v) { return glm::normalize(toWorld * glm::dvec3(level_.normals[v])); }));
  };
  if (!hasNormalMap(level_, view_, c.object) || slip_ == Slip::NormalMapIgnored) return plain();
  const Look& look = c.look();
  const glm::dvec3 colour(c.texture(look.normalTexture, Encoding::Linear));
  glm::dvec3 n = slip_ == Slip::ColourNotDecoded ? colour : colourToNormal(colour);
  if (slip_ == Slip::GreenFlipped) n.y = -n.y;
  if (slip_ == Slip::RedFlipped) n.x = -n.x;
  if (look.objectSpaceNormals) return glm::normalize(toWorld * n);
  if (slip_ != Slip::NormalScaleIgnored) n *= glm::dvec3(look.normalScale, look.normalScale, 1.0);
  if (slip_ == Slip::TangentFlipped) n.x = -n.x;
  const auto frame = [&](std::uint32_t v) {
    return worldFrame(world, glm::dvec3(level_.normals[v]), glm::dvec4(level_.tangents[v]), slip_);
  };
  return glm::normalize(c.mean([&](std::uint32_t v) {
    const TangentFrame f = frame(v);
    return n.x * f.tangent + n.y * f.bitangent + n.z * f.normal;
  }));
}

double Oracle::opennessOf(const Corners& c) const {
  if (hasOpenness(level_, maps_, c.object)) return sample(maps_.openness[level_.scene.objects[c.object].map], c.mapUv());
  const Look& look = c.look();
  return 1.0 + double(look.occlusionStrength) * (c.texture(look.occlusionTexture, Encoding::Linear).r - 1.0);
}

glm::dvec3 Oracle::illuminanceOf(const Corners& c) const {
  const std::uint32_t map = level_.scene.objects[c.object].map;
  glm::dvec2 uv = c.mapUv();
  if (slip_ == Slip::MapFlipped) uv.y = 1.0 - uv.y;
  return sample(maps_.illuminance[map], uv) / (slip_ == Slip::MapScaleMissing ? maps_.scale(map) : 1.0);
}

void Oracle::geometry(const Fragment& fragment, int x, int y) {
  if (fragment.triangle == kNone) return;
  const Corners c(level_, fragment);
  const glm::dvec4 surface = c.texture(c.look().roughnessTexture, Encoding::Linear);
  glm::dvec4 base = c.baseColor();
  if (slip_ == Slip::BaseDecodedTwice || slip_ == Slip::BaseNotDecoded)
    base = glm::dvec4(glm::pow(glm::dvec3(base), glm::dvec3(slip_ == Slip::BaseDecodedTwice ? 2.2 : 1.0 / 2.2)), base.a);
  const double metallic = double(c.material().metallic) * surface.b, roughness = double(c.look().roughness) * surface.g;
  const glm::dvec3 specular = glm::dvec3(c.look().specular) * glm::dvec3(c.texture(c.look().specularTexture, Encoding::Srgb));
  at(Target::Diffuse, x, y) = glm::vec4((1.0 - metallic) * glm::dvec3(base), opennessOf(c));
  const double gloss = c.look().dullByRoughness ? 1.0 - roughness : 1.0;
  at(Target::Specular, x, y) = glm::vec4((1.0 - metallic) * gloss * specular + metallic * glm::dvec3(base), specularPower(roughness));
  const bool turned = !fragment.front && slip_ != Slip::BackNotTurned;
  at(Target::Normal, x, y) = glm::vec4(normalToColour(turned ? -normalOf(c) : normalOf(c)), 1.0);
  at(Target::Depth, x, y) = glm::vec4(fragment.viewDepth_m, 0.0, 0.0, 1.0);
  if (hasMap(level_, maps_, view_, c.object)) at(Target::Baked, x, y) = glm::vec4(illuminanceOf(c), 1.0);
  if (fragment.front)
    at(Target::Emission, x, y) =
        glm::vec4(glm::dvec3(c.material().emission) * glm::dvec3(c.texture(c.material().emissionTexture, Encoding::Srgb)), 1.0);
}

void Oracle::lights(int x, int y) {
  glm::dvec3 ambient(view_.ambient ? level_.scene.ambient : Rgb(0.0f)), diffuse(0.0), specular(0.0);
  if (isSurface(x, y)) {
    const glm::dvec4 shine = value(Target::Specular, x, y), baked = value(Target::Baked, x, y);
    Place place{positionOf(x, y), normalAt(x, y), {}, glm::dvec3(shine), shine.a, baked.a > 0.0};
    place.toCamera = glm::normalize(view_.camera.position_m - place.position_m);
    if (place.hasMap && view_.lightMapPass) {
      ambient = glm::dvec3(0.0);
      diffuse = glm::dvec3(baked) / kPi;
    }
    for (const ShadedLight& light : level_.lights) {
      const Light::Kind kind = light.light.kind;
      if (!(kind == Light::Kind::Directional ? view_.directional : kind == Light::Kind::Point ? view_.point : view_.spot)) continue;
      const LightParts parts = lightAt(place, light, slip_);
      ambient += parts.ambient;
      diffuse += parts.diffuse;
      specular += parts.specular;
    }
  }
  at(Target::AmbientLight, x, y) = glm::vec4(ambient, 0.0);
  at(Target::DiffuseLight, x, y) = glm::vec4(diffuse, 0.0);
  at(Target::SpecularLight, x, y) = glm::vec4(specular, 0.0);
}

double Oracle::screenOpenness(int x, int y) const {
  if (!view_.screenAo || !isSurface(x, y)) return 1.0;
  constexpr int kPlaces = 32;
  constexpr double kGoldenAngle_rad = 2.39996323, kLift = 0.02;
  const double radius_m = screenAoRadius_m(level_.scene);
  const glm::dvec3 position = positionOf(x, y), n = normalAt(x, y);
  const glm::dvec3 aside = std::abs(n.y) < 0.9 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0);
  const glm::dvec3 right = glm::normalize(glm::cross(aside, n)), up = glm::cross(n, right);
  const int row = view_.height - 1 - y;  // GL counts rows from below
  const double turn = 2.0 * kPi * ((x % 4) * 4 + row % 4) / 16.0;
  const Camera& camera = view_.camera;
  const double tangent = std::tan(0.5 * camera.verticalFov_rad), aspect = double(view_.width) / view_.height;
  int hidden = 0;
  for (int i = 0; i < kPlaces; ++i) {
    const double share = (i + 0.5) / kPlaces, angle = kGoldenAngle_rad * i + turn, scale = double((i * 7 + 3) % kPlaces + 1) / kPlaces;
    const glm::dvec3 place =
        scale * scale * glm::dvec3(std::sqrt(share) * std::cos(angle), std::sqrt(share) * std::sin(angle), std::sqrt(1.0 - share));
    const glm::dvec3 there = position + radius_m * (place.x * right + place.y * up + (place.z + kLift) * n);
    const glm::dvec3 seen = glm::transpose(camera.axes) * (there - camera.position_m);
    const double depth = -seen.z;
    const glm::dvec2 screen(seen.x / (tangent * aspect * depth), seen.y / (tangent * depth));
    if (!(depth > 0.0) || std::abs(screen.x) >= 1.0 || std::abs(screen.y) >= 1.0) continue;
    const int px = int((0.5 * screen.x + 0.5) * view_.width), py = view_.height - 1 - int((0.5 * screen.y + 0.5) * view_.height);
    const double drawn = value(Target::Depth, px, py).x;
    hidden += drawn > 0.0 && depth > drawn && depth - drawn < radius_m;
  }
  return 1.0 - double(hidden) / kPlaces;
}

double Oracle::smoothedOpenness(int x, int y) const {
  const double depth = value(Target::Depth, x, y).x, radius_m = screenAoRadius_m(level_.scene);
  double sum = 0.0;
  int count = 0;
  for (int dy = -1; dy <= 2; ++dy)  // two below and one above: GL's rows run the other way
    for (int dx = -2; dx < 2; ++dx) {
      const int px = std::clamp(x + dx, 0, view_.width - 1), py = std::clamp(y + dy, 0, view_.height - 1);
      const double drawn = value(Target::Depth, px, py).x;
      if (drawn == 0.0 || std::abs(drawn - depth) > radius_m) continue;
      sum += value(Target::ScreenAo, px, py).x;
      ++count;
    }
  return sum / count;
}

void Oracle::composite(int x, int y) {
  if (!isSurface(x, y)) {
    at(Target::Radiance, x, y) = glm::vec4(level_.scene.sky, 1.0f);
    return;
  }
  const glm::dvec4 surface = value(Target::Diffuse, x, y);
  double ao = view_.bakedAo ? surface.a : 1.0;
  if (view_.screenAo) ao *= smoothedOpenness(x, y);
  if (slip_ == Slip::AoIgnored) ao = 1.0;
  glm::dvec3 albedo = slip_ == Slip::AlbedoMissing ? glm::dvec3(1.0) : glm::dvec3(surface);
  if (slip_ == Slip::AlbedoTimesPi) albedo *= kPi;
  if (slip_ == Slip::AlbedoOverPi) albedo /= kPi;
  const double aoOfDirect = slip_ == Slip::AoOnDirect || slip_ == Slip::AoOnDirectAlone ? ao : 1.0;
  if (slip_ == Slip::AoOnDirectAlone) ao = 1.0;
  const glm::dvec3 ambient(value(Target::AmbientLight, x, y)), diffuse(value(Target::DiffuseLight, x, y));
  glm::dvec3 out = albedo * (ambient * ao + diffuse * aoOfDirect) + glm::dvec3(value(Target::SpecularLight, x, y));
  if (slip_ != Slip::EmissionMissing) out += glm::dvec3(value(Target::Emission, x, y));
  at(Target::Radiance, x, y) = glm::vec4(out, 1.0);
}

void Oracle::toneMap(int x, int y) {
  glm::dvec3 c = (slip_ == Slip::ExposureMissing ? 1.0 : frame_.exposure) * glm::dvec3(value(Target::Radiance, x, y));
  if (view_.toneCurve == ToneCurve::Reinhard) c /= 1.0 + c;
  if (view_.encode)
    for (int k = 0; k < 3; ++k) c[k] = encodedSrgb(saturate(c[k]));
  at(Target::Picture, x, y) = glm::vec4(c, 1.0);
}

Frame Oracle::render(const Run& run) {
  const Image<Fragment> fragments = fragmentsOf(level_, view_);
  const auto everywhere = [&](auto&& pass) {
    parallelFor(run, std::size_t(view_.height), 1, [&](std::size_t row) {
      for (int x = 0; x < view_.width; ++x) pass(x, int(row));
    });
  };
  everywhere([&](int x, int y) { geometry(fragments.at(x, y), x, y); });
  everywhere([&](int x, int y) { lights(x, y); });
  everywhere([&](int x, int y) { at(Target::ScreenAo, x, y) = glm::vec4(float(screenOpenness(x, y))); });
  everywhere([&](int x, int y) { composite(x, y); });
  frame_.exposure = view_.exposure > 0.0 ? view_.exposure : exposureFor(frame_[Target::Radiance]);
  everywhere([&](int x, int y) { toneMap(x, y); });
  return std::move(frame_);
}

}  // namespace

Frame renderOracle(const ShadingLevel& level, const LevelMaps& maps, const View& view, const Run& run, Slip slip) {
  return Oracle(level, maps, view, slip).render(run);
}

Image<std::uint32_t> trianglesSeen(const ShadingLevel& level, const View& view) {
  const Image<Fragment> fragments = fragmentsOf(level, view);
  Image<std::uint32_t> out(view.width, view.height, kNone);
  for (std::size_t i = 0; i < out.pixels.size(); ++i) out.pixels[i] = fragments.pixels[i].triangle;
  return out;
}

}  // namespace lmc::shaders
