# Commands of the client against a farm that only answers.
include(support/schema_support.cmake)
if(TESSERA_WITH_GRPC)
  tessera_test(NAME client_commands KIND integration
    SOURCES integration/client/commands_test.cpp integration/client/compare_test.cpp
            integration/client/fake_farm.cpp integration/client/made_image.cpp
    LINKS tessera::client tessera_schema_check CLI11::CLI11 OpenImageIO::OpenImageIO GTest::gmock)
  tessera_test(NAME http_poster KIND integration SOURCES integration/client/http_poster_test.cpp LINKS tessera_webhook)
endif()
