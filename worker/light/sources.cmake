# Sources and headers of worker/light: target_sources(tessera_render PRIVATE … PUBLIC FILE_SET HEADERS …).
