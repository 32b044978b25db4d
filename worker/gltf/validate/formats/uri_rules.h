#pragma once

#include <string>
#include <string_view>

namespace tessera::render {

/// A URI that is no valid data URI: a relative path, another form of URI, or none.
enum class UriForm { relative, other, invalid };
UriForm form_of_uri(std::string_view uri);

/// Whether a URI is a data URI that can be decoded.
bool is_valid_data_uri(std::string_view uri);

/// Media type of a data URI in lower case; text/plain if it names none.
std::string media_type_of(std::string_view uri);

}  // namespace tessera::render
