// Default options of AddressSanitizer and LeakSanitizer, which call these functions.

// NOLINTBEGIN(bugprone-reserved-identifier)
extern "C" const char* __asan_default_options();
extern "C" const char* __lsan_default_suppressions();

// Clang 14 crashes at exit over the thread-local variables of a module opened while threads run
// (OpenImageIO's libraries start some).
extern "C" const char* __asan_default_options() {
  return "intercept_tls_get_addr=0";
}

// OpenImageIO leaks the text of some errors of damaged images; our own leaks are still found.
extern "C" const char* __lsan_default_suppressions() {
  return "leak:OpenImageIO";
}
// NOLINTEND(bugprone-reserved-identifier)
