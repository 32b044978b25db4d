target_sources(tessera_render
  PRIVATE light/emissive_power.cpp light/environment_map.cpp light/light_bounds.cpp light/light_table.cpp
          light/light_tree.cpp light/moving_lights.cpp light/shape_emitter.cpp
          light/special_emitters.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES light/emissive_power.h light/environment_map.h light/light_bounds.h light/light_table.h
          light/light_tree.h light/moving_lights.h light/punctual.h light/shape_emitter.h
          light/spherical_rectangle.h light/spherical_strip.h light/spherical_triangle.h)
