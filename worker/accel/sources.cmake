target_sources(tessera_render
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES accel/scene_accel.h)
