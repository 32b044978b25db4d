#include "rpc/certificates/certificate_uri.h"

#include <openssl/x509v3.h>

#include <memory>
#include <string_view>

#include "absl/strings/match.h"

namespace tessera::contract {

std::string holder_uri(const X509* certificate) {
  const std::unique_ptr<GENERAL_NAMES, void (*)(GENERAL_NAMES*)> names(
      static_cast<GENERAL_NAMES*>(
          X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr)),
      GENERAL_NAMES_free);
  std::string found;
  for (int i = 0; i < sk_GENERAL_NAME_num(names.get()); ++i) {
    const GENERAL_NAME* name = sk_GENERAL_NAME_value(names.get(), i);
    if (name->type != GEN_URI) continue;
    const ASN1_STRING* uri = name->d.uniformResourceIdentifier;
    const std::string_view text(reinterpret_cast<const char*>(ASN1_STRING_get0_data(uri)),
                                static_cast<std::size_t>(ASN1_STRING_length(uri)));
    if (!absl::StartsWith({text.data(), text.size()}, kHolderScheme)) continue;
    if (!found.empty()) return {};
    found = text;
  }
  return found;
}

}  // namespace tessera::contract
