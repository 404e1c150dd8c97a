#pragma once
/// Normal maps: between tangent and object space, from heights, from a model with more polygons. Vectors here are in glTF's sense: x along
/// the tangent, y along the bitangent (green up), z along the normal; row 0 of a picture is V = 0.
#include <cstdint>
#include <vector>

#include "libscene/image.h"
#include "libscene/run.h"
#include "libscene/scene.h"
#include "libscene/tracer.h"

namespace lmc {

/// What a model has under the middle of a texel, in the space of its file, nodes' transforms applied.
struct TexelFrame {
  glm::dvec3 position_m{0.0};
  glm::vec3 normal{0.0f}, tangent{0.0f};  ///< interpolated, not made unit: as the shader sees them
  float determinant = 0.0f;               ///< 0 = no triangle there

  bool covered() const { return determinant != 0.0f; }
  /// Columns tangent, bitangent = determinant * cross(normal, tangent), normal.
  glm::mat3 matrix() const { return {tangent, determinant * glm::cross(normal, tangent), normal}; }
};

/// Frames by TEXCOORD_0. `place`: of each vertex in the map, repeated where it leaves [0, 1]. Where triangles overlap the first has the
/// texel. Texels beside a covered one, up to `gutter` texels off, take over from it.
Image<TexelFrame> texelFrames(const Scene&, std::span<const glm::vec2> place, int width, int height, int gutter, const Run&);

/// Vector by vector; each keeps its length, so that what was rounded once is not rounded twice. Texels without a frame become +Z.
Image<glm::vec3> toTangentSpace(const Image<TexelFrame>&, const Image<glm::vec3>& object);
Image<glm::vec3> toObjectSpace(const Image<TexelFrame>&, const Image<glm::vec3>& tangent);

enum class Derivative { Central, Sobel, Scharr };  ///< [-1 0 1]/2; smoothed across by [1 2 1]/4; by [3 10 3]/16
struct HeightOptions {
  float scale = 0.05f;  ///< of height 1 above height 0, in widths of the picture
  bool repeat = true;   ///< beyond the border comes the other side, else the border itself
  Derivative filter = Derivative::Central;
};
/// Tangent space. n = (-dh/du, dh/dv, 1) made unit, for V points down and y up; texels are square.
Image<glm::vec3> normalsOfHeight(const Image<float>& height, const HeightOptions&);

/// Rec. 709 luminance [0, 1] of a picture in sRGB.
Image<float> luminanceOf(const Image<glm::u16vec4>& picture);

struct ModelNormals {
  Image<glm::vec3> normals;  ///< object space
  std::size_t rays = 0;      ///< texels with a frame
  std::size_t misses = 0;    ///< of them, those whose ray met nothing: they have the low model's own normal
};
/// A ray per texel, from `cage_m` above the low model along its smooth normal to as far below. `low` and `high` are the scenes' centres.
ModelNormals normalsOfModel(const Image<TexelFrame>&, const glm::dvec3& lowCentre_m, const Scene& high, const Tracer&, double cage_m,
                            const Run&);

/// Channels (n + 1)/2; green turned about when it points down.
Image<glm::vec3> normalsOfPicture(const Image<glm::u16vec4>& picture, bool greenDown);
Image<glm::u8vec4> pictureOfNormals8(const Image<glm::vec3>&, bool greenDown);
Image<glm::u16vec4> pictureOfNormals16(const Image<glm::vec3>&, bool greenDown);

}  // namespace lmc
