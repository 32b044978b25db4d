# glTF in, plain posed scenes out. Each third-party library is known to one file.
target_sources(tessera_render
  PRIVATE
    scene/accessor_reader.cpp scene/animation.cpp scene/animation_pointers.cpp scene/camera_extension.cpp scene/camera_setup.cpp scene/compression.cpp
    scene/container.cpp scene/core_model.cpp scene/csg_assembly.cpp scene/declared_lights.cpp scene/deform.cpp
    scene/draco_decoder.cpp
    scene/first_pass.cpp scene/folder_reader.cpp scene/geometry_reader.cpp scene/gpu_instancing.cpp scene/hierarchy.cpp
    scene/image_decoder.cpp scene/image_sources.cpp scene/inspect_report.cpp scene/json_view.cpp
    scene/loader.cpp scene/material_extensions.cpp scene/medium_reader.cpp scene/meshopt_decoder.cpp scene/needs.cpp
    scene/node_extensions.cpp scene/optics_reader.cpp scene/precision_check.cpp scene/scene_builder.cpp scene/selection.cpp scene/shape_reader.cpp scene/shutter.cpp
    scene/solid_check.cpp
    scene/tangents.cpp
    scene/terrain_reader.cpp scene/tessera_extensions.cpp scene/texture_extension.cpp scene/uri.cpp scene/volumes.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
  FILES
    scene/accessor_reader.h scene/animation.h scene/animation_pointers.h scene/camera_setup.h scene/compression.h
    scene/container.h scene/core_model.h scene/csg_assembly.h scene/declared_lights.h scene/deform.h scene/document.h scene/draco_decoder.h
    scene/extension_reader.h scene/first_pass.h scene/folder_reader.h scene/geometry_reader.h
    scene/gpu_instancing.h scene/hierarchy.h scene/image_decoder.h scene/inspect_report.h scene/json_view.h
    scene/limits.h scene/loader.h scene/medium_reader.h scene/moved_pose.h scene/meshopt_decoder.h scene/needs.h scene/scene.h
    scene/optics_reader.h scene/pose_cache.h scene/precision_check.h scene/scene_builder.h scene/selection.h scene/shape_reader.h scene/shared_array.h scene/shutter.h scene/solid_check.h
    scene/tangents.h scene/tessera_extensions.h scene/uri.h scene/volumes.h)
# tinygltf is used as a header (see core_model.cpp): nothing to link.
target_link_libraries(tessera_render
  PRIVATE nlohmann_json::nlohmann_json draco::draco
    meshoptimizer::meshoptimizer tessera::image absl::strings absl::status)
