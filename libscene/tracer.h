#pragma once
/// Rays through the level (Embree only in tracer.cpp).
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>

#include "libscene/scene.h"

namespace lmc {

/// What a ray is for; counted apart, so that a report can show what each effect cost.
enum class Purpose : std::uint8_t {
  Shadow,
  Emitter,
  Sky,
  Gather,
  Near,
  Exposure,
  PatchSky,
  Shoot,
  Visibility,
  Camera,
  Cells,
  Occlusion,
  Audit
};
inline constexpr std::array kPurposeNames{"shadow", "emitter",    "sky",    "gather", "near",      "exposure", "patch-sky",
                                          "shoot",  "visibility", "camera", "cells",  "occlusion", "audit"};

/// What was traced.
struct CastCounts {
  std::array<std::uint64_t, kPurposeNames.size()> rays{};  ///< one a purpose
  std::uint64_t holeTests = 0;                             ///< looks at the alpha of Mask materials
  CastCounts operator-(const CastCounts&) const;
};

struct Ray {
  glm::vec3 origin_m, direction;  ///< any length; tFar counts in lengths of direction
  float tFar;
};

/// Rays that start at one place, laid out as Embree takes them, so that a stream of fans needs no packing.
struct RayFan {
  static constexpr std::size_t kRays = 16;
  struct alignas(16) OneRay {
    glm::vec4 origin_m;             ///< w: where it begins, 0
    glm::vec4 direction;            ///< of any length; w: its time, 0
    float tFar;                     ///< counts in lengths of the direction; below 0: not to be cast, or blocked
    std::uint32_t mask, id, flags;  ///< ~0, 0, 0
  };
  std::array<OneRay, kRays> rays;
  Ray ray(std::size_t i, float tFar) const { return {glm::vec3(rays[i].origin_m), glm::vec3(rays[i].direction), tFar}; }
};

struct Hit {
  std::uint32_t triangle = kNone;  ///< kNone = the ray left the level
  glm::vec2 bary{0.0f};            ///< weights of the second and third corner
  float t = 0.0f;
  bool front = true;  ///< the ray met the side that is counter-clockwise
  explicit operator bool() const { return triangle != kNone; }
};

/// Static geometry that blocks light: objects with `cast`, but for Blend and transmissive materials; Mask materials with their holes.
/// Both sides block. Where a back lies within roundings before a front, walls that share a plane or reach through each other by a rounding,
/// closest() gives the front. Thread-safe; results do not depend on threads or batches.
class Tracer {
 public:
  explicit Tracer(const Scene&);
  ~Tracer();
  Tracer(const Tracer&) = delete;
  Tracer& operator=(const Tracer&) = delete;

  bool occluded(const Ray&, Purpose) const;
  void occluded(std::span<const Ray>, std::span<std::uint8_t> blocked, Purpose) const;
  /// Bit i of blocked[k]: ray i of fan k is blocked, or was not to be cast; the rays' tFar is spent. Returns the rays cast. Fans go as one
  /// stream, the fastest way of Embree's for rays of a hemisphere (bench/ao_bench).
  std::uint64_t occluded(std::span<RayFan>, std::span<std::uint16_t> blocked, Purpose) const;
  Hit closest(const Ray&, Purpose) const;
  void closest(std::span<const Ray>, std::span<Hit>, Purpose) const;
  /// Whether the back of a one-sided face was met, which nobody sees but from within a solid.
  bool isInsideOfSolid(const Hit&) const;

  /// How far a ray's start must be moved along the geometric normal so that it does not meet its own surface: 4 ulp of the level's largest
  /// coordinate, for positions computed in double from the float vertices (methods measured: 0 self hits in 1e6 rays from 1 ulp on).
  float lift_m() const { return lift_m_; }
  glm::vec3 lifted(const glm::dvec3& position_m, const glm::dvec3& normal) const {
    return glm::vec3(position_m + double(lift_m_) * normal);
  }

  std::uint64_t rays(Purpose) const;
  std::uint64_t rays() const;  ///< of all purposes
  CastCounts counts() const;
  static CastCounts castByThisThread();                              ///< so far, by any tracer
  void countAsCast(const CastCounts&) const;                         ///< rays whose results came from a journal
  std::uint64_t holeTests() const { return holeTests_.load(); }      ///< looks at the alpha of Mask materials
  std::uint32_t degenerateTriangles() const { return degenerate_; }  ///< left out: their area is below 1e-12 of the longest edge squared
  std::uint64_t bytes() const;                                       ///< held by Embree

 private:
  void preferFronts(std::span<const Ray>, std::span<Hit>) const;
  /// Adds what a call cast, and the looks at alpha that its thread has made meanwhile.
  void count(Purpose, std::uint64_t rays) const;
  struct Device;
  std::unique_ptr<Device> device_;
  float lift_m_ = 0.0f;
  std::uint32_t degenerate_ = 0;
  mutable std::array<std::atomic<std::uint64_t>, kPurposeNames.size()> counts_{};
  mutable std::atomic<std::uint64_t> holeTests_{0};
};

/// Area, in double, free of cancellation at large coordinates.
double area_m2(const std::array<glm::dvec3, 3>& corners);
bool isDegenerate(const std::array<glm::dvec3, 3>& corners);

}  // namespace lmc
