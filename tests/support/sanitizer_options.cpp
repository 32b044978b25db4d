// Defaults of AddressSanitizer and LeakSanitizer, which they ask every program for.

// NOLINTBEGIN(bugprone-reserved-identifier)
extern "C" const char* __asan_default_options();
extern "C" const char* __lsan_default_suppressions();

// Clang 14 loses its way among the thread-local variables of a module opened while threads run
// (OpenImageIO's libraries start some) and crashes at exit.
extern "C" const char* __asan_default_options() {
  return "intercept_tls_get_addr=0";
}

// OpenImageIO loses the text of some damaged images' errors; what is ours is still found.
extern "C" const char* __lsan_default_suppressions() {
  return "leak:OpenImageIO";
}
// NOLINTEND(bugprone-reserved-identifier)
