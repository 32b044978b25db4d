target_sources(tessera_render
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES render/frame_renderer.h)
