# Merging, the cache of sums, EXR and its exports.
tessera_test(NAME film KIND unit
  SOURCES unit/server/film/certainty_test.cpp unit/server/film/film_cache_test.cpp unit/server/film/frame_writer_test.cpp
          unit/server/film/merge_test.cpp
  LINKS tessera::film tessera_schema_check OpenImageIO::OpenImageIO nlohmann_json::nlohmann_json Threads::Threads)
