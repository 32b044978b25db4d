target_sources(tessera_render
  PRIVATE render/accelerator_table.cpp render/aperture.cpp render/camera_rays.cpp render/frame_renderer.cpp render/media.cpp render/numerics_check.cpp
          render/numerics_images.cpp render/parallel_tbb.cpp
          render/parallel_threads.cpp render/path_media.inc render/path_tracer.cpp render/pixel_sums.cpp
          render/ray_recorder.cpp
          render/transparency.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES render/accelerator_table.h render/aperture.h render/camera_rays.h render/flight.h render/float_control.h render/frame_renderer.h render/interior.h render/media.h render/numerics_check.h
      render/numerics_images.h render/parallel_tbb.h
          render/parallel_threads.h render/path_tracer.h render/pixel_sums.h render/ray_recorder.h render/transparency.h)
target_link_libraries(tessera_render PRIVATE TBB::tbb)
