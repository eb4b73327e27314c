// Chromium opens no data URL of more than 2 MB; a blob has no such limit.
for (const result of Object.values(results)) {
  const [type, content] = result.data_uri.split(";base64,");
  if (content && result.data_uri.length > 2e6) {
    const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
    const blob = new Blob([bytes], { type: type.slice("data:".length) });
    result.data_uri = URL.createObjectURL(blob);
  }
}
