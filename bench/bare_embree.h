#pragma once
/// A level in Embree without lmc's door to it: what lmc's rates are held against.
#include <embree3/rtcore.h>

#include <cstring>

#include "libscene/scene.h"

namespace lmc {

/// Every triangle of the level blocks; no holes.
struct BareEmbree {
  RTCDevice device;
  RTCScene scene;

  explicit BareEmbree(const Scene& level) : device(rtcNewDevice(nullptr)), scene(rtcNewScene(device)) {
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    std::memcpy(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, level.positions_m.size()),
                level.positions_m.data(), 12 * level.positions_m.size());
    std::memcpy(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, level.triangles.size()), level.triangles.data(),
                12 * level.triangles.size());
    rtcCommitGeometry(g);
    rtcAttachGeometry(scene, g);
    rtcReleaseGeometry(g);
    rtcCommitScene(scene);
  }
  ~BareEmbree() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
  BareEmbree(const BareEmbree&) = delete;
  BareEmbree& operator=(const BareEmbree&) = delete;
};

}  // namespace lmc
