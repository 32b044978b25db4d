tessera_test(NAME identity KIND unit
  SOURCES unit/server/identity/authority_test.cpp unit/server/identity/join_tokens_test.cpp
  LINKS tessera::identity)
