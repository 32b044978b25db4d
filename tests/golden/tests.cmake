# Pictures of before, as means and variances.
tessera_test(NAME golden KIND numeric
  SOURCES golden/golden_test.cpp support/folder_reader.cpp support/folder_reader.h
    support/seeded_frames.cpp support/seeded_frames.h
  LINKS tessera::film tessera::image tessera::render)
target_compile_definitions(numeric_golden_test PRIVATE TESSERA_SCENES="${PROJECT_SOURCE_DIR}/tests/scenes"
  TESSERA_GOLDEN="${PROJECT_SOURCE_DIR}/tests/golden")
