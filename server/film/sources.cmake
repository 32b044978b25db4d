# tessera_film: blocks in, images out. Gets blocks through callbacks; knows no gRPC and no store.
add_library(tessera_film)
add_library(tessera::film ALIAS tessera_film)
target_sources(tessera_film
  PRIVATE film/certainty.cpp film/exr_file.cpp film/film_cache.cpp film/frame_entry.cpp film/frame_note.cpp
          film/frame_writer.cpp film/image_export.cpp film/merge.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES film/certainty.h film/exr_file.h film/film_cache.h film/frame_note.h film/frame_writer.h
          film/image_export.h film/merge.h)
target_link_libraries(tessera_film PUBLIC tessera::flags tessera::contract absl::status absl::statusor
  PRIVATE OpenEXR::OpenEXR tessera::image nlohmann_json::nlohmann_json)
