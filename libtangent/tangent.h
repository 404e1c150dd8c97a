#pragma once
/// Tangent space after MikkTSpace: a tangent and a determinant for every corner of every face. Knows GLM alone.
/// Source: [mikktspace] of docs/references.md; docs/tangents.md has the algorithm as it is built here.
///
///   safe   compute():          for files. Every tangent finite, of unit length and orthogonal to its normal; what the reference leaves
///                              undefined is mended, counted and said.
///   exact  computeReference(): the reference's own values, bit by bit, its zero vectors, fillers and infinities included.
#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <new>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace lmc::tangent {

void* allocateArray(std::size_t bytes, std::size_t alignment);  ///< throws std::bad_alloc; large ones ask for large pages
void freeArray(void* array, std::size_t bytes, std::size_t alignment);

/// An allocator that leaves new elements as they are: arrays of millions of corners are written once, not twice.
template <class T>
struct Unset {
  using value_type = T;
  Unset() = default;
  template <class U>
  Unset(const Unset<U>&) {}
  T* allocate(std::size_t n) { return static_cast<T*>(allocateArray(n * sizeof(T), alignof(T))); }
  void deallocate(T* array, std::size_t n) { freeArray(array, n * sizeof(T), alignof(T)); }
  template <class U, class... Arguments>
  void construct(U* place, Arguments&&... arguments) {
    if constexpr (sizeof...(Arguments) > 0) ::new (static_cast<void*>(place)) U(std::forward<Arguments>(arguments)...);
  }
  friend bool operator==(const Unset&, const Unset&) { return true; }
};
template <class T>
using Array = std::vector<T, Unset<T>>;

/// Views only; the caller keeps the arrays alive. A corner is one place of `indices`; faces follow one another there.
struct Surface {
  std::span<const glm::vec3> positions, normals;  ///< per vertex, one length; any unit of length
  std::span<const glm::vec2> uvs;                 ///< per vertex; V as stored, glTF's points down
  std::span<const std::uint32_t> indices;         ///< vertex of each corner
  std::span<const std::uint8_t> faceSizes;        ///< corners of each face; empty = all triangles. Only 3 and 4 get tangents of their own
};

/// What makes a surface impossible to work on, in words with the corner's number (sizes that do not agree, a vertex that is not there);
/// empty when there is nothing. Values that are not finite are no problem: they are mended.
std::string problemWith(const Surface&);

/// How the caller lets work run side by side. The results are the same bits for any loop and any number of threads.
struct Loop {
  int threads = 1;                                                                        ///< how finely work is cut
  std::function<void(std::size_t n, const std::function<void(std::size_t)>& body)> each;  ///< body(i) for all i < n; empty = one by one
};
/// A loop on threads of its own, for callers that have none.
Loop threadedLoop(int threads);

/// glTF's sense: bitangent = cross(normal, tangent) * determinant, and green points along it.
struct CornerTangent {
  glm::vec3 tangent;  ///< unit, orthogonal to the normal within 1e-3
  float determinant;  ///< +1, or -1 where the UVs are mirrored; minus the reference's sign
};

/// Why a corner's tangent differs from the reference's.
enum class Mend : std::uint8_t {
  NotFinite,      ///< the reference gives NaN or infinity: input that is not finite, or lengths that underflow
  Zero,           ///< its sum cancels, or the normal lies along the tangent
  NoFrame,        ///< no triangle with an area in UV reaches the corner: it has the filler (1, 0, 0)
  NotOrthogonal,  ///< farther than 1e-3 from the normal's plane: the normal is not of unit length, or belongs to another corner
  NotUnit,        ///< its length is off by more than 1e-5
};
inline constexpr int kMendCount = 5;
const char* textOf(Mend);  ///< "not finite", "zero", ...

struct MendedCorner {
  std::uint32_t corner;
  Mend why;
};

/// What was done: for reports.
struct Counts {
  std::size_t triangles = 0;   ///< quads count twice
  std::size_t degenerate = 0;  ///< of them, those with two equal positions
  std::size_t frameless = 0;   ///< of them, those whose UVs or sides have no size to speak of
  std::size_t welded = 0;      ///< vertices that became one with another: equal position, normal and UV
  std::size_t groups = 0;      ///< corners of one vertex that share a tangent, before opposite ones part
  std::size_t hugeGroups = 0;  ///< groups whose opposite tangents were too many to part (docs/tangents.md)
};

struct Tangents {
  Array<CornerTangent> corners;      ///< one per corner, in their order
  std::vector<MendedCorner> mended;  ///< by ascending corner
  Counts counts;
};

/// Safe mode. A determinant is always +1 or -1. Throws std::invalid_argument with problemWith()'s words.
Tangents compute(const Surface&, const Loop& = {});

struct ReferenceTangent {
  glm::vec3 tangent;    ///< may be zero, the filler (1, 0, 0), or not finite
  float referenceSign;  ///< the reference's: bitangent = sign * cross(normal, tangent) with V as stored; minus the determinant
};
struct ReferenceTangents {
  Array<ReferenceTangent> corners;
  Counts counts;
};

/// Exact mode: equal bits with the reference implementation (angular threshold 180 degrees) wherever that does not hang on its sorting
/// defects. Throws std::invalid_argument with problemWith()'s words.
ReferenceTangents computeReference(const Surface&, const Loop& = {});

}  // namespace lmc::tangent
