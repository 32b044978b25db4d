# tessera_identity: who is who. The farm's own certificate authority, revocations, join tokens.
add_library(tessera_identity)
add_library(tessera::identity ALIAS tessera_identity)
target_sources(tessera_identity
  PRIVATE identity/authority.cpp identity/identity.cpp identity/join_tokens.cpp
          identity/private_file.cpp identity/revocations.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES identity/authority.h identity/identity.h identity/join_tokens.h
          identity/openssl_objects.h identity/private_file.h identity/revocations.h)
target_link_libraries(tessera_identity
  PUBLIC tessera::contract absl::status absl::statusor OpenSSL::Crypto
  PRIVATE absl::strings)
