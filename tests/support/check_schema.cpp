#include <iostream>
#include <iterator>

#include "tests/support/json_schema.h"

// check_schema < DOCUMENT: 0 if the JSON document follows the schema it names, else its faults. For
// scripts in tests/e2e.

int main() {
  const std::string text(std::istreambuf_iterator<char>(std::cin), {});
  const std::vector<std::string> faults = tessera::support::document_faults(text);
  for (const std::string& fault : faults) std::cerr << fault << "\n";
  return faults.empty() ? 0 : 1;
}
