#include "worker/inspect/near_vertices.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <tuple>

namespace tessera::render {
namespace {

using accelerators::Neighbour;
using accelerators::SearchStats;

constexpr std::size_t kMaxListedPairs = 100;
constexpr double kTolerance = 1e-5;

struct Vertex {
  Vec3f at;
  std::int32_t node;
};

/// Returns the first vertices and counts all of them.
std::vector<Vertex> placed_vertices(const Scene& scene, std::size_t max_vertices,
                                    std::int64_t& count) {
  std::vector<Vertex> vertices;
  for (const Instance& instance : scene.instances) {
    for (const Primitive& p : scene.meshes[static_cast<std::size_t>(instance.mesh)].primitives) {
      count += static_cast<std::int64_t>(p.positions.size());
      for (const Vec3f& position : p.positions) {
        if (vertices.size() == max_vertices) break;
        const Vec3d at = transform_point(instance.object_to_world, Vec3d(position));
        vertices.push_back({Vec3f(at), instance.node});
      }
    }
  }
  return vertices;
}

/// Keeps one vertex per position, in the order of positions.
void unite_equal(std::vector<Vertex>& vertices) {
  const auto key = [](const Vertex& v) { return std::tuple(v.at.x, v.at.y, v.at.z); };
  std::stable_sort(vertices.begin(), vertices.end(),
                   [&](const Vertex& a, const Vertex& b) { return key(a) < key(b); });
  const auto same = [&](const Vertex& a, const Vertex& b) { return key(a) == key(b); };
  vertices.erase(std::unique(vertices.begin(), vertices.end(), same), vertices.end());
}

nlohmann::json cost_of(const SearchStats& stats, std::int64_t searches) {
  const auto n = static_cast<double>(std::max<std::int64_t>(1, searches));
  return {{"nodes_per_search", static_cast<double>(stats.nodes) / n},
          {"points_per_search", static_cast<double>(stats.points) / n}};
}

nlohmann::json search_cost(const VertexDistances& distances) {
  return {{"searches", distances.places},
          {"kd_tree", cost_of(distances.kd_tree, distances.places)},
          {"bvh", cost_of(distances.bvh, distances.places)},
          {"wrong", distances.wrong}};
}

}  // namespace

VertexDistances measure_vertex_distances(const Scene& scene, std::size_t max_vertices) {
  VertexDistances out;
  std::vector<Vertex> vertices = placed_vertices(scene, max_vertices, out.vertices);
  unite_equal(vertices);
  out.places = static_cast<std::int64_t>(vertices.size());
  out.tolerance = kTolerance * max_abs(scene.bounds_max - scene.bounds_min);
  if (vertices.size() < 2) return out;
  std::vector<Vec3f> points;
  points.reserve(vertices.size());
  for (const Vertex& vertex : vertices) points.push_back(vertex.at);
  const auto kd_tree = accelerators::build_point_kd_tree(points);
  const auto bvh = accelerators::build_point_bvh(points);
  std::vector<Neighbour> others;
  for (const Vec3f& point : points) {
    const std::vector<Neighbour> found = bvh->nearest(point, 2, out.bvh);
    if (kd_tree->nearest(point, 2, out.kd_tree) != found) ++out.wrong;
    others.push_back(found[1]);  // found[0] is the point itself
  }
  std::vector<double> distances;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const Neighbour& other = others[i];
    const double distance = std::sqrt(other.distance_squared);
    distances.push_back(distance);
    const bool listed = other.point < i && others[other.point].point == i;
    if (distance > out.tolerance || listed) continue;
    out.near.push_back({distance, points[i], {vertices[i].node, vertices[other.point].node}});
  }
  std::stable_sort(
      out.near.begin(), out.near.end(),
      [](const NearVertices& a, const NearVertices& b) { return a.distance < b.distance; });
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  out.median = *middle;
  out.smallest = *std::min_element(distances.begin(), distances.end());
  return out;
}

std::string to_json(const VertexDistances& distances, const Scene& scene) {
  nlohmann::json pairs = nlohmann::json::array();
  for (const NearVertices& pair : distances.near) {
    if (pairs.size() == kMaxListedPairs) break;
    const Vec3d at = Vec3d(pair.at) + scene.center;
    pairs.push_back({{"distance", pair.distance},
                     {"at", {at.x, at.y, at.z}},
                     {"nodes", {pair.nodes[0], pair.nodes[1]}}});
  }
  return nlohmann::json{{"vertices", distances.vertices},      {"tolerance", distances.tolerance},
                        {"smallest", distances.smallest},      {"median", distances.median},
                        {"pair_count", distances.near.size()}, {"pairs", pairs},
                        {"nearest", search_cost(distances)}}
      .dump();
}

std::string search_cost_json(const VertexDistances& distances) {
  return search_cost(distances).dump();
}

}  // namespace tessera::render
