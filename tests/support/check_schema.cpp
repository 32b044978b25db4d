#include <iostream>
#include <iterator>

#include "tests/support/json_schema.h"

// check_schema < DOCUMENT: exits with 0 if the JSON document is valid under the schema that it
// names, else prints its faults. Used by scripts in tests/e2e.

int main() {
  const std::string text(std::istreambuf_iterator<char>(std::cin), {});
  const std::vector<std::string> faults = tessera::support::document_faults(text);
  for (const std::string& fault : faults) std::cerr << fault << "\n";
  return faults.empty() ? 0 : 1;
}
