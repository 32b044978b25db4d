#pragma once

#include <openssl/types.h>

#include <string>

namespace tessera::contract {

/// A certificate names its holder by the URI tessera://ROLE/NAME.
inline constexpr char kHolderScheme[] = "tessera://";

/// Returns the only URI of that scheme among a certificate's subject alternative names; "" for none
/// or several.
std::string holder_uri(const X509* certificate);

}  // namespace tessera::contract
