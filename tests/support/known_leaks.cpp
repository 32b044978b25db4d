// OpenImageIO loses the text of some damaged images' errors; what is ours is still found.
extern "C" const char* __lsan_default_suppressions();  // NOLINT(bugprone-reserved-identifier)
extern "C" const char* __lsan_default_suppressions() {
  return "leak:OpenImageIO";
}
