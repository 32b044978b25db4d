#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "worker/scene/scene.h"

namespace tessera::render::bench {

/// A scene for tracing rays, with a camera and a light.
struct BenchScene {
  std::string name;
  Scene scene;
  Vec3f eye, target;
  float yfov = 0.8f;              // radians
  Vec3f light, light_u, light_v;  // a rectangle: corner and sides
  float scale = 1;                // a typical length, for the offset of new rays
};

/// Returns the names that make_scene() accepts, in the order of reports.
std::vector<std::string> scene_names();

/// Generates a scene by name, with a few thousand triangles if `quick`. Deterministic.
BenchScene make_scene(const std::string& name, bool quick);

/// Generates a terrain of cells x cells squares of two triangles each.
BenchScene make_terrain(std::uint32_t cells);

/// Generates parallel squares, each of two triangles, that all fill the view.
BenchScene make_layers(int layers);

/// Returns the number of triangles of all meshes, not multiplied by their instances.
std::int64_t triangle_count(const Scene& scene);

}  // namespace tessera::render::bench
