"""Reader of USD and USDZ files, based on OpenUSD (`pbrnet[usd]`), which runs in a child process."""
