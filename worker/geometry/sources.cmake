# Sources and headers of worker/geometry: target_sources(tessera_render PRIVATE … PUBLIC FILE_SET HEADERS …).
