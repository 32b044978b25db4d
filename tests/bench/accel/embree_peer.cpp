#include "tests/bench/accel/embree_peer.h"

#include <embree3/rtcore.h>

#include <array>
#include <atomic>
#include <vector>

namespace tessera::render::bench {
namespace {

RTCRay to_embree(const Ray& ray) {
  RTCRay r{};
  r.org_x = ray.origin.x;
  r.org_y = ray.origin.y;
  r.org_z = ray.origin.z;
  r.dir_x = ray.direction.x;
  r.dir_y = ray.direction.y;
  r.dir_z = ray.direction.z;
  r.tnear = 0;
  r.tfar = ray.t_max;
  r.mask = ~0u;
  return r;
}

RTCScene new_scene(RTCDevice device) {
  RTCScene scene = rtcNewScene(device);
  rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
  return scene;
}

void attach_primitive(RTCDevice device, RTCScene scene, const Primitive& p) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_HIGH);
  void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                           sizeof(Vec3f), p.positions.size());
  std::copy(p.positions.begin(), p.positions.end(), static_cast<Vec3f*>(vertices));
  void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                          sizeof(p.triangles[0]), p.triangles.size());
  std::copy(p.triangles.begin(), p.triangles.end(),
            static_cast<std::array<std::uint32_t, 3>*>(indices));
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
}

void attach_instance(RTCDevice device, RTCScene scene, RTCScene mesh, const Affine3d& m) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
  rtcSetGeometryInstancedScene(geometry, mesh);
  std::array<float, 12> columns{};
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      columns[static_cast<std::size_t>(3 * column + row)] =
          static_cast<float>(m.rows[static_cast<std::size_t>(row)][column]);
    }
    columns[static_cast<std::size_t>(9 + row)] = static_cast<float>(m.translation[row]);
  }
  rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns.data());
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
}

}  // namespace

struct EmbreePeer::State {
  RTCDevice device = nullptr;
  std::vector<RTCScene> meshes;
  RTCScene scene = nullptr;
  std::atomic<std::int64_t> bytes{0};
};

EmbreePeer::EmbreePeer(const Scene& scene) : state_(std::make_unique<State>()) {
  state_->device = rtcNewDevice("threads=1,set_affinity=0");
  rtcSetDeviceMemoryMonitorFunction(
      state_->device,
      [](void* state, ssize_t bytes, bool) {
        static_cast<State*>(state)->bytes += bytes;
        return true;
      },
      state_.get());
  for (const Mesh& mesh : scene.meshes) {
    RTCScene one = new_scene(state_->device);
    for (const Primitive& p : mesh.primitives) attach_primitive(state_->device, one, p);
    rtcCommitScene(one);
    state_->meshes.push_back(one);
  }
  if (scene.instances.size() == 1 && scene.instances[0].object_to_world == Affine3d{}) {
    state_->scene = state_->meshes[static_cast<std::size_t>(scene.instances[0].mesh)];
    rtcRetainScene(state_->scene);
    return;
  }
  state_->scene = new_scene(state_->device);
  for (const Instance& instance : scene.instances) {
    attach_instance(state_->device, state_->scene,
                    state_->meshes[static_cast<std::size_t>(instance.mesh)],
                    instance.object_to_world);
  }
  rtcCommitScene(state_->scene);
}

EmbreePeer::~EmbreePeer() {
  rtcReleaseScene(state_->scene);
  for (RTCScene mesh : state_->meshes) rtcReleaseScene(mesh);
  rtcReleaseDevice(state_->device);
}

std::int64_t EmbreePeer::closest_hits(std::span<const Ray> rays) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  std::int64_t hits = 0;
  for (const Ray& ray : rays) {
    RTCRayHit query{to_embree(ray), {}};
    query.hit.geomID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(state_->scene, &context, &query);
    hits += query.hit.geomID != RTC_INVALID_GEOMETRY_ID ? 1 : 0;
  }
  return hits;
}

std::int64_t EmbreePeer::any_hits(std::span<const Ray> rays) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  std::int64_t hits = 0;
  for (const Ray& ray : rays) {
    RTCRay query = to_embree(ray);
    rtcOccluded1(state_->scene, &context, &query);
    hits += query.tfar < 0 ? 1 : 0;
  }
  return hits;
}

std::int64_t EmbreePeer::closest_hits_16(std::span<const Ray> rays) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  std::int64_t hits = 0;
  for (std::size_t first = 0; first < rays.size(); first += 16) {
    alignas(64) RTCRayHit16 query{};
    alignas(64) std::array<int, 16> valid{};
    for (std::size_t k = 0; k < 16; ++k) {
      query.hit.geomID[k] = query.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
      if (first + k >= rays.size()) continue;
      const Ray& ray = rays[first + k];
      valid[k] = -1;
      query.ray.org_x[k] = ray.origin.x;
      query.ray.org_y[k] = ray.origin.y;
      query.ray.org_z[k] = ray.origin.z;
      query.ray.dir_x[k] = ray.direction.x;
      query.ray.dir_y[k] = ray.direction.y;
      query.ray.dir_z[k] = ray.direction.z;
      query.ray.tfar[k] = ray.t_max;
      query.ray.mask[k] = ~0u;
    }
    rtcIntersect16(valid.data(), state_->scene, &context, &query);
    for (std::size_t k = 0; k < 16; ++k) {
      hits += query.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID ? 1 : 0;
    }
  }
  return hits;
}

bool EmbreePeer::closest_hit(const Ray& ray, float& t) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{to_embree(ray), {}};
  query.hit.geomID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(state_->scene, &context, &query);
  t = query.ray.tfar;
  return query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
}

std::int64_t EmbreePeer::memory_bytes() const {
  return state_->bytes;
}

}  // namespace tessera::render::bench
