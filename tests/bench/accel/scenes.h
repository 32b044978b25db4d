#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "worker/scene/scene.h"

namespace tessera::render::bench {

/// A scene to trace rays in, with where to look from and what casts light.
struct BenchScene {
  std::string name;
  Scene scene;
  Vec3f eye, target;
  float yfov = 0.8f;              // radians
  Vec3f light, light_u, light_v;  // a rectangle: corner and sides
  float scale = 1;                // a typical length, for the offset of new rays
};

/// Names make_scene() knows, in the order of the table.
std::vector<std::string> scene_names();

/// Generates a scene by name; `quick` makes it a few thousand triangles. Deterministic.
BenchScene make_scene(const std::string& name, bool quick);

/// The terrain with so many cells a side, two triangles each.
BenchScene make_terrain(std::uint32_t cells);

/// Squares behind each other, all of which fill the view: two triangles a layer.
BenchScene make_layers(int layers);

/// Triangles over all instances' meshes, each mesh once.
std::int64_t triangle_count(const Scene& scene);

}  // namespace tessera::render::bench
