"""The gallery: fresh runs of scenes and policies, their pictures, and the page that shows them."""
