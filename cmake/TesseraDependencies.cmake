# Finds the Debian 12 packages. Targets link them by their imported names.

find_package(absl CONFIG REQUIRED)
find_package(OpenSSL REQUIRED)
find_package(nlohmann_json CONFIG REQUIRED)
find_package(Threads REQUIRED)
find_package(TBB CONFIG REQUIRED)
find_package(zstd CONFIG REQUIRED)
find_package(SQLite3 REQUIRED)
find_package(TinyGLTF CONFIG REQUIRED)
find_package(draco CONFIG REQUIRED)
find_package(meshoptimizer CONFIG REQUIRED)
find_package(CLI11 CONFIG REQUIRED)
find_package(spdlog CONFIG REQUIRED)
find_package(CURL REQUIRED)
find_package(prometheus-cpp CONFIG REQUIRED)
find_package(OpenEXR CONFIG REQUIRED)
find_package(PNG REQUIRED)
find_package(JPEG REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(WebP REQUIRED IMPORTED_TARGET libwebp)  # Debian ships no CMake file of it
pkg_check_modules(Seccomp REQUIRED IMPORTED_TARGET libseccomp)
pkg_check_modules(Jemalloc REQUIRED IMPORTED_TARGET jemalloc)

if(TESSERA_BUILD_TESTS)  # tests write and read images with it, as an oracle
  # OpenImageIO's package names an OpenCV include folder that need not exist.
  find_package(OpenImageIO CONFIG REQUIRED)
  foreach(target OpenImageIO::OpenImageIO OpenImageIO::OpenImageIO_Util)
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES /usr/include)
  endforeach()
endif()

if(TESSERA_WITH_GRPC)
  find_package(Protobuf REQUIRED)  # CMake's module: Debian ships no protobuf-config.cmake
  find_package(gRPC CONFIG REQUIRED)
  find_program(GRPC_CPP_PLUGIN grpc_cpp_plugin REQUIRED)
endif()
