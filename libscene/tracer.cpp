#include "libscene/tracer.h"

#include <embree3/rtcore.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <utility>

#include "libscene/error.h"
#include "libscene/float_traps.h"
#include "libscene/texture.h"

namespace lmc {

double area_m2(const std::array<glm::dvec3, 3>& c) { return 0.5 * glm::length(glm::cross(c[1] - c[0], c[2] - c[0])); }

bool isDegenerate(const std::array<glm::dvec3, 3>& c) {
  const glm::dvec3 a = c[1] - c[0], b = c[2] - c[0], d = c[2] - c[1];
  const double longest2 = std::max({glm::dot(a, a), glm::dot(b, b), glm::dot(d, d)});
  return !(area_m2(c) > 1e-12 * longest2);
}

namespace {

constexpr int kBacksInAPlane = 4;
constexpr std::size_t kBatch = 256;  // rays of one texel that go to Embree at once
#ifdef __SANITIZE_THREAD__
// Embree's own workers run no code that the sanitizer sees, and a signal that comes to one of them waits in it for such code.
constexpr const char* kDeviceSettings = "threads=1";
#else
constexpr const char* kDeviceSettings = nullptr;
#endif

/// One Embree geometry and which triangles of the scene it holds.
struct Part {
  const Scene* scene = nullptr;
  std::vector<std::uint32_t> triangles;
};

thread_local std::uint64_t holeTestsOfThread = 0;  ///< of this thread, not yet counted

/// A hole is a hit that does not count.
void rejectHoles(const RTCFilterFunctionNArguments* args) {
  const Part& part = *static_cast<const Part*>(args->geometryUserPtr);
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    ++holeTestsOfThread;
    const glm::vec2 bary(RTCHitN_u(args->hit, args->N, i), RTCHitN_v(args->hit, args->N, i));
    const std::uint32_t triangle = part.triangles[RTCHitN_primID(args->hit, args->N, i)];
    if (alphaAt(*part.scene, triangle, bary) < part.scene->materialOf(triangle).alphaCutoff) args->valid[i] = 0;
  }
}

RTCRay toEmbree(const Ray& ray) {
  RTCRay r;
  r.org_x = ray.origin_m.x;
  r.org_y = ray.origin_m.y;
  r.org_z = ray.origin_m.z;
  r.dir_x = ray.direction.x;
  r.dir_y = ray.direction.y;
  r.dir_z = ray.direction.z;
  r.tnear = 0.0f;
  r.tfar = ray.tFar;
  r.time = 0.0f;
  r.mask = ~0u;
  r.id = 0;
  r.flags = 0;
  return r;
}

}  // namespace

struct Tracer::Device {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  Part parts[2];  // opaque, masked: only the second pays for a filter
  std::atomic<std::int64_t> bytes{0};

  static bool onMemory(void* self, ssize_t bytes, bool) {
    static_cast<Device*>(self)->bytes += bytes;
    return true;
  }
  ~Device() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }

  void attach(const Scene& level, unsigned id) {
    Part& part = parts[id];
    part.scene = &level;
    if (part.triangles.empty()) return;
    RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* vertices = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3), level.positions_m.size());
    auto* indices =
        static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, part.triangles.size()));
    if (!vertices || !indices) throw Error(Exit::Limit, level.file, "", "not enough memory for the ray tracer", "LMC_MEMORY");
    std::memcpy(vertices, level.positions_m.data(), level.positions_m.size() * sizeof(glm::vec3));
    for (const std::uint32_t t : part.triangles) {
      const glm::uvec3 v = level.triangles[t];
      *indices++ = v.x;
      *indices++ = v.y;
      *indices++ = v.z;
    }
    if (id == 1) {
      rtcSetGeometryUserData(g, &part);
      rtcSetGeometryIntersectFilterFunction(g, rejectHoles);
      rtcSetGeometryOccludedFilterFunction(g, rejectHoles);
    }
    // MEDIUM: with HIGH, primitive numbers and so hits may depend on the number of threads.
    rtcSetGeometryBuildQuality(g, RTC_BUILD_QUALITY_MEDIUM);
    rtcCommitGeometry(g);
    rtcAttachGeometryByID(scene, g, id);
    rtcReleaseGeometry(g);
  }

  Hit toHit(const RTCRayHit& r) const {
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
    Hit hit;
    hit.triangle = parts[r.hit.geomID].triangles[r.hit.primID];
    hit.bary = {r.hit.u, r.hit.v};
    hit.t = r.ray.tfar;
    // Ng = cross(v1 - v0, v2 - v0): against the ray on the front.
    hit.front = r.hit.Ng_x * r.ray.dir_x + r.hit.Ng_y * r.ray.dir_y + r.hit.Ng_z * r.ray.dir_z < 0.0f;
    return hit;
  }
};

Tracer::Tracer(const Scene& scene) : device_(std::make_unique<Device>()) {
  const NoFloatTraps embree;
  Device& d = *device_;
  d.device = rtcNewDevice(kDeviceSettings);
  if (!d.device) {
    const RTCError e = rtcGetDeviceError(nullptr);
    if (e == RTC_ERROR_OUT_OF_MEMORY) throw Error(Exit::Limit, scene.file, "", "not enough memory for the ray tracer", "LMC_MEMORY");
    throw Error(Exit::Internal, "", "", fmt::format("the ray tracer does not start (Embree error {})", int(e)));
  }
  rtcSetDeviceMemoryMonitorFunction(d.device, Device::onMemory, &d);
  d.scene = rtcNewScene(d.device);
  rtcSetSceneFlags(d.scene, RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(d.scene, RTC_BUILD_QUALITY_MEDIUM);
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    const Object& object = scene.objectOf(t);
    const Material& material = scene.materials[object.material];
    if (!object.cast || !material.opaqueToLight()) continue;
    if (isDegenerate(scene.corners_m(t))) {
      ++degenerate_;
      continue;
    }
    d.parts[material.alpha == Material::Alpha::Mask ? 1 : 0].triangles.push_back(t);
  }
  d.attach(scene, 0);
  d.attach(scene, 1);
  rtcCommitScene(d.scene);
  if (const RTCError e = rtcGetDeviceError(d.device); e != RTC_ERROR_NONE)
    throw Error(e == RTC_ERROR_OUT_OF_MEMORY ? Exit::Limit : Exit::Internal, scene.file, "",
                fmt::format("the ray tracer cannot take the level (Embree error {})", int(e)));
  const float extent = std::max(scene.extent_m, std::numeric_limits<float>::min());
  lift_m_ = 4.0f * (std::nextafter(extent, std::numeric_limits<float>::infinity()) - extent);
}

Tracer::~Tracer() = default;

bool Tracer::occluded(const Ray& ray, Purpose purpose) const {
  std::uint8_t blocked = 0;
  occluded({&ray, 1}, {&blocked, 1}, purpose);
  return blocked != 0;
}

void Tracer::occluded(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Purpose purpose) const {
  assert(rays.size() == blocked.size());
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  RTCRay buffer[kBatch];
  for (std::size_t at = 0; at < rays.size(); at += kBatch) {
    const std::size_t n = std::min(kBatch, rays.size() - at);
    for (std::size_t i = 0; i < n; ++i) buffer[i] = toEmbree(rays[at + i]);
    const NoFloatTraps embree;
    if (n == 1)
      rtcOccluded1(device_->scene, &context, buffer);
    else
      rtcOccluded1M(device_->scene, &context, buffer, unsigned(n), sizeof(RTCRay));
    for (std::size_t i = 0; i < n; ++i) blocked[at + i] = buffer[i].tfar < 0.0f;  // Embree sets tfar to -inf where a ray is blocked
  }
  count(purpose, rays.size());
}

// One fan after the other is an array of Embree's rays.
static_assert(sizeof(RayFan::OneRay) == sizeof(RTCRay) && alignof(RayFan::OneRay) == alignof(RTCRay));
static_assert(sizeof(RayFan) == RayFan::kRays * sizeof(RTCRay));
static_assert(offsetof(RayFan::OneRay, direction) == offsetof(RTCRay, dir_x) && offsetof(RayFan::OneRay, tFar) == offsetof(RTCRay, tfar));
static_assert(offsetof(RayFan::OneRay, mask) == offsetof(RTCRay, mask) && offsetof(RayFan::OneRay, flags) == offsetof(RTCRay, flags));

/// 1 or 0: cheaper than to compare. No tFar is -0.
static unsigned isBelow0(float tFar) { return std::bit_cast<std::uint32_t>(tFar) >> 31; }

std::uint64_t Tracer::occluded(std::span<RayFan> fans, std::span<std::uint16_t> blocked, Purpose purpose) const {
  assert(fans.size() == blocked.size());
  std::uint64_t cast = fans.size() * RayFan::kRays;
  for (const RayFan& f : fans)
    for (const RayFan::OneRay& r : f.rays) cast -= isBelow0(r.tFar);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  {
    const NoFloatTraps embree;
    rtcOccluded1M(device_->scene, &context, reinterpret_cast<RTCRay*>(fans.data()), unsigned(fans.size() * RayFan::kRays), sizeof(RTCRay));
  }
  for (std::size_t k = 0; k < fans.size(); ++k) {
    unsigned bits = 0;
    for (std::size_t i = RayFan::kRays; i-- > 0;) bits = 2 * bits + isBelow0(fans[k].rays[i].tFar);
    blocked[k] = std::uint16_t(bits);
  }
  count(purpose, cast);
  return cast;
}

Hit Tracer::closest(const Ray& ray, Purpose purpose) const {
  Hit hit;
  closest({&ray, 1}, {&hit, 1}, purpose);
  return hit;
}

void Tracer::closest(std::span<const Ray> rays, std::span<Hit> hits, Purpose purpose) const {
  assert(rays.size() == hits.size());
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  RTCRayHit buffer[kBatch];
  for (std::size_t at = 0; at < rays.size(); at += kBatch) {
    const std::size_t n = std::min(kBatch, rays.size() - at);
    for (std::size_t i = 0; i < n; ++i) {
      buffer[i].ray = toEmbree(rays[at + i]);
      buffer[i].hit.geomID = RTC_INVALID_GEOMETRY_ID;
      buffer[i].hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    }
    {
      const NoFloatTraps embree;
      rtcIntersect1M(device_->scene, &context, buffer, unsigned(n), sizeof(RTCRayHit));
    }
    for (std::size_t i = 0; i < n; ++i) hits[at + i] = device_->toHit(buffer[i]);
    // Whether a place is buried is asked of what is met first: within a box that reaches to the ceiling, the ceiling is no sight of a room.
    if (purpose != Purpose::Exposure) preferFronts(rays.subspan(at, n), hits.subspan(at, n));
  }
  count(purpose, rays.size());
}

/// A back that is met may lie in the plane of a front, or before it by what vertices are rounded by: then rays that come from the front's
/// room must see the front. From each back that was met a second ray looks as far as lift_m() goes, square to the back.
void Tracer::preferFronts(std::span<const Ray> rays, std::span<Hit> hits) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit second;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    Hit& hit = hits[i];
    if (!hit || hit.front) continue;
    const auto c = device_->parts[0].scene->corners_m(hit.triangle);
    const glm::dvec3 n = glm::normalize(glm::cross(c[1] - c[0], c[2] - c[0]));
    const double slope = std::abs(glm::dot(n, glm::dvec3(rays[i].direction)));
    second.ray = toEmbree(rays[i]);
    // From as far before it, too: of two in one plane either may have been met.
    const double reach = double(lift_m_) / slope;
    second.ray.tnear = float(std::max(0.0, double(hit.t) - reach));
    second.ray.tfar = float(std::min(double(rays[i].tFar), double(hit.t) + reach));
    if (!(second.ray.tnear < second.ray.tfar) || !std::isfinite(second.ray.tfar)) continue;
    // Past backs: each one that is met moves the start on, a few at most.
    for (int attempt = 0; attempt < kBacksInAPlane; ++attempt) {
      second.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      second.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      const float far = second.ray.tfar;
      {
        const NoFloatTraps embree;
        rtcIntersect1(device_->scene, &context, &second);
      }
      const Hit other = device_->toHit(second);
      if (!other) break;
      if (other.front) {
        hit = other;
        break;
      }
      second.ray.tnear = std::nextafter(other.t, INFINITY);
      second.ray.tfar = far;
    }
  }
}

bool Tracer::isInsideOfSolid(const Hit& hit) const {
  return hit && !hit.front && !device_->parts[0].scene->materialOf(hit.triangle).doubleSided;
}

namespace {
thread_local CastCounts castHere;
}

CastCounts CastCounts::operator-(const CastCounts& o) const {
  CastCounts out = *this;
  for (std::size_t p = 0; p < rays.size(); ++p) out.rays[p] -= o.rays[p];
  out.holeTests -= o.holeTests;
  return out;
}

void Tracer::count(Purpose purpose, std::uint64_t rays) const {
  counts_[std::size_t(purpose)].fetch_add(rays, std::memory_order_relaxed);
  castHere.rays[std::size_t(purpose)] += rays;
  if (holeTestsOfThread == 0) return;
  const std::uint64_t tests = std::exchange(holeTestsOfThread, 0);
  holeTests_.fetch_add(tests, std::memory_order_relaxed);
  castHere.holeTests += tests;
}

CastCounts Tracer::castByThisThread() { return castHere; }

void Tracer::countAsCast(const CastCounts& cast) const {
  for (std::size_t p = 0; p < cast.rays.size(); ++p) counts_[p].fetch_add(cast.rays[p], std::memory_order_relaxed);
  holeTests_.fetch_add(cast.holeTests, std::memory_order_relaxed);
}

CastCounts Tracer::counts() const {
  CastCounts out;
  for (std::size_t p = 0; p < out.rays.size(); ++p) out.rays[p] = counts_[p].load();
  out.holeTests = holeTests_.load();
  return out;
}

std::uint64_t Tracer::rays(Purpose purpose) const { return counts_[std::size_t(purpose)].load(); }

std::uint64_t Tracer::rays() const {
  std::uint64_t sum = 0;
  for (const auto& c : counts_) sum += c.load();
  return sum;
}

std::uint64_t Tracer::bytes() const { return std::uint64_t(std::max<std::int64_t>(0, device_->bytes.load())); }

}  // namespace lmc
